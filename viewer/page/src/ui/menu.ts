/** A button that opens a panel below it. */

import { make, makeButton, setAttribute, setShown, type Child } from "./dom";
import { makeIcon, type IconName } from "./icons";

export interface MenuOptions {
  testId: string;
  label: string;
  icon: IconName;
  /** Is called before the panel opens. */
  onOpen?: () => void;
}

export class Menu {
  readonly element: HTMLElement;
  readonly panel: HTMLElement;
  private readonly button: HTMLButtonElement;

  constructor(options: MenuOptions, ...children: readonly Child[]) {
    const { testId, label, icon } = options;
    this.panel = make(
      "div",
      { class: "panel menu-panel", id: `${testId}-panel`, "data-testid": `${testId}-panel`, hidden: true },
      ...children,
    );
    this.button = makeButton(
      { testId, label, class: "tool", onClick: () => this.setOpen(this.panel.hidden, options.onOpen) },
      makeIcon(icon),
      make("span", { class: "tool-label" }, label),
    );
    setAttribute(this.button, "aria-expanded", "false");
    setAttribute(this.button, "aria-controls", this.panel.id);
    this.element = make("div", { class: "menu" }, this.button, this.panel);
    // Wherever the focus is: a choice that was made with the pointer gives it back to the levers.
    document.addEventListener("keydown", (event) => {
      if (event.key !== "Escape" || this.panel.hidden) return;
      event.stopPropagation();
      this.close();
      this.button.focus();
    });
    document.addEventListener("pointerdown", (event) => {
      if (event.target instanceof Node && !this.element.contains(event.target)) this.close();
    });
  }

  close(): void {
    this.setOpen(false);
  }

  private setOpen(isOpen: boolean, onOpen?: () => void): void {
    if (isOpen) onOpen?.();
    setShown(this.panel, isOpen);
    setAttribute(this.button, "aria-expanded", String(isOpen));
  }
}

export interface Choice {
  value: string;
  label: string;
}

/** Exclusive choices. */
export class ChoiceList {
  readonly element: HTMLElement;
  private readonly inputs: HTMLInputElement[] = [];

  constructor(title: string, testId: string, choices: readonly Choice[], onChange: (value: string) => void) {
    this.element = make("fieldset", { class: "choices", "data-testid": testId }, make("legend", {}, title));
    for (const { value, label } of choices) {
      const input = make("input", { type: "radio", name: testId, value, "data-testid": `${testId}-${value}` });
      input.addEventListener("change", () => onChange(value));
      this.inputs.push(input);
      this.element.append(make("label", { class: "choice" }, input, make("span", {}, label)));
    }
  }

  set(value: string): void {
    for (const input of this.inputs) if (input.checked !== (input.value === value)) input.checked = input.value === value;
  }
}

/** A switch with a label. */
export class Switch {
  readonly element: HTMLElement;
  private readonly input: HTMLInputElement;

  constructor(label: string, testId: string, onChange: (on: boolean) => void) {
    this.input = make("input", { type: "checkbox", role: "switch", "data-testid": testId });
    this.input.addEventListener("change", () => onChange(this.input.checked));
    this.element = make("label", { class: "switch" }, this.input, make("span", {}, label));
  }

  set(on: boolean): void {
    if (this.input.checked !== on) this.input.checked = on;
  }
}
