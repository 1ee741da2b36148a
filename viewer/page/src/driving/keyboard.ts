/** Keys of the keyboard as held levers and as actions. */

import { HeldKeys } from "./held_keys";
import { keyName } from "./key_names";

export interface KeyboardHandlers {
  /** Return whether a key deflects a lever now. */
  isLever(name: string): boolean;
  /** Receive the held keys that deflect levers, on each change. */
  heldChanged(held: string[]): void;
  /** Receive a press of any other key; return whether it had a meaning. */
  pressed(name: string, event: KeyboardEvent): boolean;
  /** The window lost the focus: all levers must be released. */
  focusLost(): void;
}

/**
 * Listens to the keys of a window. Keys count as released when the window loses the focus or is hidden, since their
 * release would go to another window, and with the command key of macOS, which suppresses releases.
 */
export class Keyboard {
  private readonly held = new HeldKeys();

  constructor(
    window: Window,
    private readonly handlers: KeyboardHandlers,
  ) {
    window.addEventListener("keydown", this.onDown, { capture: true });
    window.addEventListener("keyup", this.onUp, { capture: true });
    window.addEventListener("blur", this.onFocusLost);
    window.addEventListener("pagehide", this.onFocusLost);
    window.document.addEventListener("visibilitychange", () => {
      if (window.document.hidden) this.onFocusLost();
    });
  }

  /** Release all keys. */
  releaseAll(): void {
    if (this.held.releaseAll()) this.handlers.heldChanged([]);
  }

  private readonly onDown = (event: KeyboardEvent): void => {
    if (event.key === "Meta") this.releaseAll();
    if (event.isComposing || takesText(event.target)) return;
    const name = keyName(event);
    // The space bar, which stops the machine, has its meaning with any other key.
    if (name !== " " && (event.ctrlKey || event.metaKey || event.altKey)) return;
    if (this.handlers.isLever(name) && !usesArrows(event.target, name)) {
      event.preventDefault();
      if (this.held.press(name, event.repeat)) this.handlers.heldChanged(this.held.list);
    } else if (!event.repeat && this.handlers.pressed(name, event)) {
      event.preventDefault();
      event.stopPropagation();
    }
  };

  private readonly onUp = (event: KeyboardEvent): void => {
    const name = keyName(event);
    if (this.held.release(name)) this.handlers.heldChanged(this.held.list);
    // The space bar stops the machine and does not press the button that has the focus.
    if (name === " " && !takesText(event.target)) event.preventDefault();
  };

  private readonly onFocusLost = (): void => {
    this.handlers.focusLost();
    this.releaseAll();
  };
}

/** Return whether typing in this element enters text. */
function takesText(target: EventTarget | null): boolean {
  if (!(target instanceof HTMLElement)) return false;
  if (target.isContentEditable || target instanceof HTMLTextAreaElement || target instanceof HTMLSelectElement) {
    return true;
  }
  return target instanceof HTMLInputElement && !["range", "checkbox", "radio", "button"].includes(target.type);
}

/** Return whether an element that was reached with the keyboard uses this arrow key itself. */
function usesArrows(target: EventTarget | null, name: string): boolean {
  return (
    ["up", "down", "left", "right"].includes(name) &&
    target instanceof HTMLInputElement &&
    ["range", "radio"].includes(target.type)
  );
}
