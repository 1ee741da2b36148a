/** The nodes whose diagnostics are not OK, in a place of fixed height: the gauges below it do not move. */

import { make, setAttribute } from "./dom";

type Status = Record<string, string | number | boolean>;

export class Conditions {
  private readonly list = make("ul", {
    class: "conditions",
    "data-testid": "conditions",
    tabindex: "0",
    "aria-label": "Conditions of the nodes",
  });
  private shown: string | null = null;
  readonly element = make("div", { class: "conditions-place" }, this.list);

  constructor() {
    new ResizeObserver(() => this.markMore()).observe(this.element);
  }

  /** @param status conditions by node: `OK`, or level and text. */
  update(status: Status): void {
    const entries = Object.entries(status).filter(([, text]) => typeof text === "string" && text !== "OK");
    const isError = ([, text]: (typeof entries)[number]): boolean => String(text).startsWith("ERROR");
    entries.sort((a, b) => Number(isError(b)) - Number(isError(a))); // errors are seen without pointing at the list
    const summary = Object.keys(status).length > 0 ? "All nodes are OK" : "No diagnostics";
    const state = entries.map(([name, text]) => `${name}: ${text}`).join("\n") || summary;
    if (state === this.shown) return;
    this.shown = state;
    const items = entries.map(([name, text]) => {
      const [level = "", ...rest] = String(text).split(": ");
      return make("li", { "data-level": level }, make("strong", {}, name), ` ${rest.join(": ") || level}`);
    });
    this.list.replaceChildren(...(items.length > 0 ? items : [make("li", { "data-level": "OK" }, summary)]));
    this.markMore();
  }

  /** Mark a list that does not fit. It is shown whole, over the gauges, while it is pointed at or has the focus. */
  private markMore(): void {
    setAttribute(this.list, "data-more", this.list.scrollHeight > this.element.clientHeight + 1);
  }
}
