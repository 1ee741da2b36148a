/** Polls the gamepad and reports its deflections; without one, nothing runs. */

import { isAtRest, mergeDeflections, type Deflections } from "./deflections";
import { gamepadDeflections, isStartPressed, isStopPressed } from "./gamepad_mapping";

/**
 * Interval at which the gamepad is read [ms]: a press of a button that is shorter is lost. A timer, because a browser that
 * draws without a graphics card may draw one frame a second.
 */
export const POLL_INTERVAL_MS = 15;

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
 * Uses the first gamepad that is connected, at an interval that does not depend on drawing. A stick that is deflected when
 * the gamepad counts again, counts once it was in its middle. In a hidden page only the stop counts: browsers run its timers
 * once a second or less, so the release of a stick would be late.
 */
export class Gamepads {
  private index: number | null = null;
  private timer: number | undefined;
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
    this.window.clearInterval(this.timer);
    this.index = pad?.index ?? null;
    this.handlers.deflected({});
    this.handlers.connectionChanged(pad?.id ?? null, pad?.mapping === "standard");
    if (pad?.mapping !== "standard") return;
    this.timer = this.window.setInterval(this.poll, POLL_INTERVAL_MS);
    this.poll();
  }

  private readonly poll = (): void => {
    const pad = this.index === null ? null : (this.window.navigator.getGamepads()[this.index] ?? null);
    if (pad === null) {
      this.handlers.deflected({}); // the event of its disconnection may follow later
      return;
    }
    const isBlocked = this.window.document.hidden || this.handlers.isBlocked();
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
  };
}
