/** Explanation of the colours of the terrain. */

import { clamp } from "../clamp";
import type { Rgb } from "../protocol";
import type { Part, UiContext } from "./context";
import { make, setShown } from "./dom";
import { formatName, formatNumber } from "./format";
import type { Legend as LegendContent } from "./interfaces";

/** Every so many updates the legend is read: its range follows the site slowly. */
const UPDATES_PER_READING = 6;

export class Legend implements Part {
  readonly element = make("section", {
    class: "panel legend",
    "data-testid": "legend",
    "aria-label": "Legend of the colours",
  });
  private shown = "";
  private updates = 0;

  constructor(private readonly context: UiContext) {
    this.element.hidden = true;
  }

  update(): void {
    if (this.updates++ % UPDATES_PER_READING === 0) this.refresh();
  }

  /** Read the legend now. */
  refresh(): void {
    const legend = this.context.app.view.legend();
    setShown(this.element, legend !== null);
    const state = JSON.stringify(legend);
    if (legend === null || state === this.shown) return;
    this.shown = state;
    const unit = legend.kind === "gradient" && legend.unit ? make("small", {}, legend.unit) : null;
    const body = legend.kind === "gradient" ? gradient(legend.stops) : swatches(legend.items);
    this.element.replaceChildren(make("h2", {}, legend.title, " ", unit), body);
  }
}

type Gradient = Extract<LegendContent, { kind: "gradient" }>["stops"];
type Swatches = Extract<LegendContent, { kind: "swatches" }>["items"];

/** Number of intervals between the numbers of a scale. */
const NUM_INTERVALS = 4;

function swatches(items: Swatches): HTMLElement {
  const list = make("ul", { class: "swatches" });
  for (const { label, color } of items) {
    const swatch = make("span", { class: "swatch", "aria-hidden": "true" });
    swatch.style.background = css(color);
    list.append(make("li", {}, swatch, formatName(label)));
  }
  return list;
}

function gradient(stops: Gradient): HTMLElement {
  const low = stops[0]?.value ?? 0;
  const range = (stops.at(-1)?.value ?? low) - low || 1;
  const position = (value: number): string => `${((100 * (value - low)) / range).toFixed(2)}%`;
  const strip = make("div", { class: "gradient-strip", "aria-hidden": "true" });
  strip.style.background = `linear-gradient(to right, ${stops.map((s) => `${css(s.color)} ${position(s.value)}`).join(", ")})`;
  const labels = make("div", { class: "gradient-labels" });
  const decimals = clamp(Math.ceil(-Math.log10(range / NUM_INTERVALS)), 0, 3);
  for (let i = 0; i <= NUM_INTERVALS; i++) {
    const value = low + (range * i) / NUM_INTERVALS;
    const label = make("span", {}, formatNumber(value, decimals));
    label.style.left = position(value);
    labels.append(label);
  }
  return make("div", { class: "gradient" }, strip, labels);
}

function css(color: Rgb): string {
  return `rgb(${color.map((value) => Math.round(255 * value)).join(" ")})`;
}
