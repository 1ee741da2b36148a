/** Diagrams of the levers and pedals, which move with their deflection and name what each direction moves. */

import type { Control, Deflections } from "../driving/deflections";
import { keyInscription } from "../driving/key_names";
import type { UiContext } from "./context";
import { make, setText, type Child } from "./dom";
import { controlWords } from "./joint_words";

export type Side = "left" | "right";

type Direction = "north" | "south" | "west" | "east";

/** Axis and sign of each direction of a lever: positive is to the left and forward. */
const DIRECTIONS: readonly { direction: Direction; axis: "x" | "y"; sign: 1 | -1 }[] = [
  { direction: "north", axis: "y", sign: 1 },
  { direction: "west", axis: "x", sign: 1 },
  { direction: "east", axis: "x", sign: -1 },
  { direction: "south", axis: "y", sign: -1 },
];

/** Travel of a knob to full deflection [% of the size of its pad]. */
const KNOB_TRAVEL = 32;

interface Label {
  control: Control;
  sign: 1 | -1;
  key: HTMLElement;
  words: HTMLElement;
}

/** Names of keys and motions around a lever or pedal. */
class Labels {
  private readonly labels: Label[] = [];

  constructor(private readonly context: UiContext) {}

  /** Make the label of a direction. */
  make(direction: Direction, control: Control, sign: 1 | -1): HTMLElement {
    const key = make("kbd");
    const words = make("span", { class: "lever-words" });
    this.labels.push({ control, sign, key, words });
    return make("div", { class: `lever-label lever-${direction}` }, key, words);
  }

  update(): void {
    const machine = this.context.machine();
    const layout = this.context.keyboardLayout();
    const keys = this.context.app.world.hello?.keys ?? {};
    for (const { control, sign, key, words } of this.labels) {
      const name = keyOf(keys, control, sign);
      setText(key, name === null ? "" : keyInscription(name, layout));
      key.hidden = name === null;
      setText(words, machine === null ? "" : controlWords(machine.message, control, sign));
    }
  }
}

/** A lever with two axes. */
export class LeverDiagram {
  private readonly knob = make("span", { class: "lever-knob" });
  private readonly labels: Labels;
  /** Circle in which the knob moves. */
  readonly pad = make("div", { class: "lever-pad" }, make("span", { class: "lever-cross" }), this.knob);
  readonly element: HTMLElement;
  private transform = "";

  constructor(
    context: UiContext,
    readonly side: Side,
    title: string,
    testId: string,
  ) {
    this.labels = new Labels(context);
    const labels: Child[] = DIRECTIONS.map(({ direction, axis, sign }) =>
      this.labels.make(direction, `${side}_${axis}`, sign),
    );
    this.element = make(
      "figure",
      { class: "lever", "data-testid": testId },
      make("figcaption", {}, title),
      this.pad,
      ...labels,
    );
  }

  updateLabels(): void {
    this.labels.update();
  }

  /** Move the knob. */
  move(deflections: Deflections): void {
    const x = -(deflections[`${this.side}_x`] ?? 0);
    const y = -(deflections[`${this.side}_y`] ?? 0);
    const size = Math.max(Math.hypot(x, y), 1); // within the circle
    const transform = `translate(${((KNOB_TRAVEL * x) / size).toFixed(1)}cqw, ${((KNOB_TRAVEL * y) / size).toFixed(1)}cqw)`;
    if (transform !== this.transform) this.knob.style.transform = this.transform = transform;
  }
}

/** The pedal of one track. */
export class PedalDiagram {
  private readonly knob = make("span", { class: "pedal-knob" });
  private readonly labels: Labels;
  /** Slot in which the knob moves. */
  readonly pad = make("div", { class: "pedal-pad" }, this.knob);
  readonly element: HTMLElement;
  private transform = "";

  constructor(
    context: UiContext,
    readonly side: Side,
    testId: string,
  ) {
    this.labels = new Labels(context);
    this.element = make(
      "figure",
      { class: "pedal", "data-testid": testId },
      make("figcaption", {}, side === "left" ? "Left track" : "Right track"),
      this.labels.make("north", `${side}_pedal`, 1),
      this.pad,
      this.labels.make("south", `${side}_pedal`, -1),
    );
  }

  updateLabels(): void {
    this.labels.update();
  }

  /** Move the knob. */
  move(deflections: Deflections): void {
    const transform = `translateY(${(-KNOB_TRAVEL * (deflections[`${this.side}_pedal`] ?? 0)).toFixed(1)}cqh)`;
    if (transform !== this.transform) this.knob.style.transform = this.transform = transform;
  }
}

/** Return the key that deflects only this control in this direction; null if there is none. */
function keyOf(keys: Record<string, Record<string, number>>, control: Control, sign: 1 | -1): string | null {
  for (const [name, deflections] of Object.entries(keys)) {
    const entries = Object.entries(deflections);
    if (entries.length === 1 && Math.sign(deflections[control] ?? 0) === sign) return name;
  }
  return null;
}
