/** Short messages that appear and leave by themselves. */

import { make, makeButton } from "./dom";
import { makeIcon } from "./icons";

/** How long a message stays [ms]. */
const SHOWN_MS = 7000;
const MAX_TOASTS = 4;

export type ToastKind = "info" | "error";

export class Toasts {
  readonly element = make("div", { class: "toasts", "data-testid": "toasts", role: "log", "aria-live": "polite" });

  /** Show a message; the same message twice is shown once, for longer. */
  show(text: string, kind: ToastKind = "info"): void {
    for (const old of this.element.children) if (old.firstChild?.textContent === text) old.remove();
    while (this.element.children.length >= MAX_TOASTS) this.element.firstElementChild?.remove();
    const toast = make(
      "div",
      { class: `toast toast-${kind}`, "data-testid": `toast-${kind}` },
      make("span", {}, text),
      makeButton(
        { testId: "toast-close", label: "Close this message", class: "icon-button", onClick: () => toast.remove() },
        makeIcon("close"),
      ),
    );
    this.element.append(toast);
    setTimeout(() => toast.remove(), SHOWN_MS);
  }
}
