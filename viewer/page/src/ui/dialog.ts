/** Modal dialogs; while one is open, no key drives. */

import { make, makeButton, type Child } from "./dom";
import { makeIcon } from "./icons";

/** Make a dialog with a title and a button that closes it. */
export function makeDialog(title: string, testId: string, ...children: readonly Child[]): HTMLDialogElement {
  const dialog = make(
    "dialog",
    { class: "dialog", "data-testid": testId, "aria-label": title },
    make(
      "header",
      { class: "panel-header" },
      make("h2", { class: "panel-title" }, title),
      makeButton(
        { testId: `${testId}-close`, label: "Close", class: "icon-button", onClick: () => dialog.close() },
        makeIcon("close"),
      ),
    ),
    make("div", { class: "dialog-body" }, ...children),
  );
  dialog.addEventListener("click", (event) => {
    if (event.target === dialog) dialog.close(); // outside of its contents
  });
  return dialog;
}

/** Ask a question; `onConfirm` is called if the user agrees. */
export function askConfirmation(
  parent: HTMLElement,
  question: { title: string; text: string; action: string; testId: string },
  onConfirm: () => void,
): void {
  const dialog = makeDialog(
    question.title,
    question.testId,
    make("p", {}, question.text),
    make(
      "div",
      { class: "dialog-buttons" },
      makeButton(
        { testId: `${question.testId}-cancel`, label: "Cancel", onClick: () => dialog.close() },
        "Cancel",
      ),
      makeButton(
        {
          testId: `${question.testId}-confirm`,
          label: question.action,
          class: "button button-danger",
          onClick: () => {
            dialog.close();
            onConfirm();
          },
        },
        question.action,
      ),
    ),
  );
  dialog.addEventListener("close", () => dialog.remove());
  parent.append(dialog);
  dialog.showModal();
}

/** Return whether a modal dialog is open. */
export function isDialogOpen(): boolean {
  return document.querySelector("dialog[open]") !== null;
}
