/** Rows with a label, a bar and a number. */

import { clamp } from "../clamp";
import { make, setAttribute, setText } from "./dom";

/** A row with a bar of one or more lines. */
export class BarRow {
  readonly element: HTMLElement;
  private readonly value: HTMLElement;
  private readonly lines: { line: HTMLElement; fill: HTMLElement; transform: string }[] = [];

  /**
   * @param lines classes of the lines of the bar, from above.
   */
  constructor(label: string, testId: string, lines: readonly string[]) {
    const bar = make("span", { class: "bar", "aria-hidden": "true" });
    for (const kind of lines) {
      const fill = make("span", { class: "bar-fill" });
      const line = make("span", { class: `bar-line ${kind}` }, fill);
      bar.append(line);
      this.lines.push({ line, fill, transform: "" });
    }
    this.value = make("span", { class: "row-value", "data-testid": testId });
    this.element = make(
      "div",
      { class: "bar-row" },
      make("span", { class: "row-label", title: label }, label),
      bar,
      this.value,
    );
  }

  /** Fill a line from the left; `share` 0 to 1. */
  setFill(line: number, share: number, isWarning = false): void {
    this.transform(line, `scaleX(${limit(share).toFixed(3)})`, isWarning);
  }

  /** Fill a line from its middle; `share` -1 to 1. */
  setCentered(line: number, share: number, isWarning = false): void {
    const size = Math.min(Math.abs(share), 1) / 2;
    this.transform(line, `translateX(${share < 0 ? ((0.5 - size) * 100).toFixed(1) : "50"}%) scaleX(${size.toFixed(3)})`, isWarning);
  }

  /** Place the mark of a line; `share` 0 to 1. */
  setMark(line: number, share: number, isWarning = false): void {
    this.transform(line, `translateX(${(limit(share) * 100).toFixed(1)}%)`, isWarning);
  }

  setValue(text: string): void {
    setText(this.value, text);
  }

  private transform(line: number, transform: string, isWarning: boolean): void {
    const entry = this.lines[line];
    if (entry === undefined) return;
    if (entry.transform !== transform) entry.fill.style.transform = entry.transform = transform;
    setAttribute(entry.line, "data-warning", isWarning);
  }
}

/** A label with a number. */
export class ValueRow {
  readonly element: HTMLElement;
  readonly value: HTMLElement;

  constructor(label: string, testId: string, title?: string) {
    this.value = make("span", { class: "row-value", "data-testid": testId });
    this.element = make("div", { class: "value-row", title }, make("span", { class: "row-label" }, label), this.value);
  }

  setValue(text: string): void {
    setText(this.value, text);
  }
}

function limit(share: number): number {
  return clamp(Number.isFinite(share) ? share : 0, 0, 1);
}
