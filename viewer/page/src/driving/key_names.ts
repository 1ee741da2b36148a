/**
 * Names of keys. The server names keys by the character that they have on a US keyboard (`teleop/key_layout.py`). Levers
 * are a matter of where the fingers are, so that a letter is taken by the position of its key (`KeyboardEvent.code`):
 * the two hands keep their places on QWERTZ, AZERTY and Cyrillic keyboards, with caps lock or shift.
 */

/** What is read of a `KeyboardEvent`. */
export interface KeyInput {
  readonly code: string;
  readonly key: string;
}

const NAMES_BY_CODE: Readonly<Record<string, string>> = {
  Space: " ",
  ArrowUp: "up",
  ArrowDown: "down",
  ArrowLeft: "left",
  ArrowRight: "right",
  NumpadAdd: "+",
  NumpadSubtract: "-",
};

/** Characters, not positions: their keys differ between layouts. `=` and `_` share their keys on a US keyboard. */
const NAMES_BY_CHARACTER: Readonly<Record<string, string>> = { "+": "+", "=": "+", "-": "-", _: "-" };

/** Return the server's name of a key; of a key that the server does not know, its character in lower case. */
export function keyName(input: KeyInput): string {
  const byCode = NAMES_BY_CODE[input.code];
  if (byCode !== undefined) return byCode;
  const byCharacter = NAMES_BY_CHARACTER[input.key];
  if (byCharacter !== undefined) return byCharacter;
  const letter = /^Key([A-Z])$/.exec(input.code)?.[1];
  if (letter !== undefined) return letter.toLowerCase();
  // On-screen keyboards and remote desktops may send no code.
  return input.key.replace(/^Arrow/, "").toLowerCase();
}

/** Return the inscription of a key for the user; `layout` has the characters of this keyboard by code, if known. */
export function keyInscription(name: string, layout: ReadonlyMap<string, string> | null = null): string {
  const symbols: Readonly<Record<string, string>> = { " ": "Space", up: "↑", down: "↓", left: "←", right: "→", "-": "−" };
  const symbol = symbols[name];
  if (symbol !== undefined) return symbol;
  return (layout?.get(`Key${name.toUpperCase()}`) ?? name).toUpperCase();
}
