/** Polls the gamepad and reports its deflections; without one, nothing runs. */

import { isAtRest, mergeDeflections, type Deflections } from "./deflections";
import { gamepadDeflections, isStartPressed, isStopPressed } from "./gamepad_mapping";

export interface GamepadHandlers {
  /** Return whether only the stop counts now, as while a dialog is open. */
  isBlocked(): boolean;
  deflected(deflections: Deflections): void;
  stopPressed(): void;
  startPressed(): void;
  /** Receive the name of the gamepad in use, null if there is none; `isStandard`: whether its mapping is known. */
  connectionChanged(name: string | null, isStandard: boolean): void;
}

/**
 * Uses the first gamepad that is connected, once a frame of the display. A stick that is deflected when the gamepad counts
 * again, counts once it was in its middle.
 */
export class Gamepads {
  private index: number | null = null;
  private request = 0;
  private wasStopPressed = false;
  private wasStartPressed = false;
  private waitsForRest = false;

  constructor(
    private readonly window: Window,
    private readonly handlers: GamepadHandlers,
  ) {
    window.addEventListener("gamepadconnected", () => this.select());
    window.addEventListener("gamepaddisconnected", () => this.select());
    this.select();
  }

  private select(): void {
    const pads = [...this.window.navigator.getGamepads()].filter((pad) => pad !== null);
    const pad = pads.find((each) => each.mapping === "standard") ?? pads[0] ?? null;
    this.window.cancelAnimationFrame(this.request);
    this.index = pad?.index ?? null;
    this.handlers.deflected({});
    this.handlers.connectionChanged(pad?.id ?? null, pad?.mapping === "standard");
    if (pad?.mapping === "standard") this.poll();
  }

  private readonly poll = (): void => {
    const pad = this.index === null ? null : (this.window.navigator.getGamepads()[this.index] ?? null);
    if (pad === null) return;
    const isBlocked = this.handlers.isBlocked();
    const deflections = gamepadDeflections(pad);
    if (isBlocked) this.waitsForRest = true;
    else if (isAtRest(mergeDeflections(deflections))) this.waitsForRest = false;
    this.handlers.deflected(this.waitsForRest ? {} : deflections);
    const isStop = isStopPressed(pad);
    const isStart = isStartPressed(pad);
    if (isStop && !this.wasStopPressed) this.handlers.stopPressed();
    if (isStart && !this.wasStartPressed && !isBlocked) this.handlers.startPressed();
    this.wasStopPressed = isStop;
    this.wasStartPressed = isStart;
    this.request = this.window.requestAnimationFrame(this.poll);
  };
}
