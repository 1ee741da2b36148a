/** The on-screen levers: left hand and right hand, at the lower corners. */

import type { Deflections } from "../driving/deflections";
import { TouchLevers } from "../driving/touch_levers";
import type { Part, UiContext } from "./context";
import { make, setShown } from "./dom";
import { LeverDiagram, PedalDiagram, type Side } from "./lever_diagram";

export class TouchPanels implements Part {
  readonly left: HTMLElement;
  readonly right: HTMLElement;
  private readonly diagrams: (LeverDiagram | PedalDiagram)[] = [];
  private readonly levers: TouchLevers;
  private isOn = false;

  /** @param changed receives the deflections of the fingers. */
  constructor(
    private readonly context: UiContext,
    changed: (deflections: Deflections) => void,
  ) {
    this.levers = new TouchLevers(changed);
    this.left = this.makePanel("left");
    this.right = this.makePanel("right");
  }

  get element(): HTMLElement {
    return this.left;
  }

  setOn(on: boolean): void {
    if (this.isOn && !on) this.levers.release();
    this.isOn = on;
    this.update();
  }

  /** Release all levers. */
  release(): void {
    this.levers.release();
  }

  /** Move the knobs to the present deflections. */
  move(): void {
    if (!this.isOn) return;
    const deflections = this.context.deflections();
    for (const diagram of this.diagrams) diagram.move(deflections);
  }

  update(): void {
    const { hello } = this.context.app.world;
    const isShown = this.isOn && hello?.source === "live" && hello.may_drive;
    setShown(this.left, isShown);
    setShown(this.right, isShown);
    if (isShown) for (const diagram of this.diagrams) diagram.updateLabels();
  }

  private makePanel(side: Side): HTMLElement {
    const title = side === "left" ? "Left lever" : "Right lever";
    const lever = new LeverDiagram(this.context, side, title, `touch-lever-${side}`);
    const pedal = new PedalDiagram(this.context, side, `touch-pedal-${side}`);
    this.levers.addLever(lever.pad, side);
    this.levers.addPedal(pedal.pad, side);
    this.diagrams.push(lever, pedal);
    const parts = side === "left" ? [lever.element, pedal.element] : [pedal.element, lever.element];
    return make("div", { class: `touch-panel touch-${side}`, "data-testid": `touch-${side}`, hidden: true }, ...parts);
  }
}
