/** Levers and pedals on the screen, for fingers: each follows one pointer and springs back when it is lifted. */

import type { Deflections } from "./deflections";
import { leverDeflection, pedalDeflection } from "./touch_deflection";

/** Share of the size of a lever's circle that the finger travels to full deflection. */
const TRAVEL_SHARE = 0.42;

export class TouchLevers {
  private readonly parts: Map<HTMLElement, Deflections> = new Map();
  private readonly pointers = new Map<HTMLElement, number>();

  /** @param changed receives the deflections of all levers and pedals. */
  constructor(private readonly changed: (deflections: Deflections) => void) {}

  /** Make a lever of an element; the pointer deflects it from the middle of the element. */
  addLever(pad: HTMLElement, side: "left" | "right"): void {
    this.add(pad, (dx, dy, box) => {
      const { x, y } = leverDeflection(dx, dy, TRAVEL_SHARE * Math.min(box.width, box.height));
      return side === "left" ? { left_x: x, left_y: y } : { right_x: x, right_y: y };
    });
  }

  /** Make a pedal of an element. */
  addPedal(pad: HTMLElement, side: "left" | "right"): void {
    this.add(pad, (_, dy, box) => {
      const value = pedalDeflection(dy, TRAVEL_SHARE * box.height);
      return side === "left" ? { left_pedal: value } : { right_pedal: value };
    });
  }

  /** Release all levers; fingers that are still on one must be lifted first. */
  release(): void {
    for (const [pad, pointer] of this.pointers) {
      if (pad.hasPointerCapture(pointer)) pad.releasePointerCapture(pointer);
      delete pad.dataset.active;
    }
    this.pointers.clear();
    this.parts.clear();
    this.changed({});
  }

  private add(pad: HTMLElement, read: (dx: number, dy: number, box: DOMRect) => Deflections): void {
    const follow = (event: PointerEvent): void => {
      const box = pad.getBoundingClientRect();
      const dx = event.clientX - (box.left + box.width / 2);
      const dy = event.clientY - (box.top + box.height / 2);
      this.parts.set(pad, read(dx, dy, box));
      this.report();
    };
    pad.addEventListener("pointerdown", (event) => {
      if (this.pointers.has(pad)) return;
      event.preventDefault();
      pad.setPointerCapture(event.pointerId);
      this.pointers.set(pad, event.pointerId);
      pad.dataset.active = "";
      follow(event);
    });
    pad.addEventListener("pointermove", (event) => {
      if (this.pointers.get(pad) === event.pointerId) follow(event);
    });
    const lift = (event: PointerEvent): void => {
      if (this.pointers.get(pad) !== event.pointerId) return;
      this.pointers.delete(pad);
      this.parts.delete(pad);
      delete pad.dataset.active;
      this.report();
    };
    pad.addEventListener("pointerup", lift);
    pad.addEventListener("pointercancel", lift);
    pad.addEventListener("lostpointercapture", lift);
    pad.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  private report(): void {
    this.changed(Object.assign({}, ...this.parts.values()) as Deflections);
  }
}
