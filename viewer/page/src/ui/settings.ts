/** Choices of the user, kept by the browser. */

const PREFIX = "earthmoving.";

/** Return a kept choice; null if there is none, or if the browser keeps nothing. */
export function readSetting(name: string): string | null {
  try {
    return localStorage.getItem(PREFIX + name);
  } catch {
    return null; // Storage is disabled.
  }
}

/** Keep a choice. */
export function writeSetting(name: string, value: string): void {
  try {
    localStorage.setItem(PREFIX + name, value);
  } catch {
    // Storage is disabled or full; the choice lasts as long as the page.
  }
}
