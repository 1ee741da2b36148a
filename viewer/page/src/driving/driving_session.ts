/** Control of one machine by this page: taking and releasing it, and the messages that drive it. */

import { clamp } from "../clamp";
import type { ControlMessage, PageMessage } from "../protocol";
import { areEqual, isAtRest, mergeDeflections, type Deflections } from "./deflections";

/** Interval of the messages while in control [ms]; the server releases the levers after 300 ms without one. */
export const DRIVE_INTERVAL_MS = 50;

/** Least interval of messages for changed deflections [ms]: a pointer or stick changes up to 1000 times a second. */
export const CHANGE_INTERVAL_MS = 15;

const MIN_SPEED = 0.1;
const SPEED_STEP = 0.1;

/**
 * `unavailable`: not connected, a bag, no right to drive, or no machine. `free`: nobody drives the machine.
 * `requested`: this page asked for control. `driving`: this page has it. `taken`: another page has it.
 */
export type DrivingState = "unavailable" | "free" | "requested" | "driving" | "taken";

/** Sources of deflections beside the keys. */
export type DeflectionSource = "gamepad" | "touch";

/**
 * State machine without DOM: the caller passes messages of the server, inputs and a clock, and calls `tick` every
 * `DRIVE_INTERVAL_MS`. Control is never taken again by itself: not after a lost connection, not after a take-over.
 */
export class DrivingSession {
  private machine: string | null = null;
  private mayDrive = false;
  private drivers: ControlMessage["drivers"] = {};
  private isRequested = false;
  /** Whether the machine was selected in place of another one, and not by the user. */
  private isReplacement = false;
  /** Source whose deflection asked for control. */
  private requester: DeflectionSource | null = null;
  private held: readonly string[] = [];
  private readonly sources: Record<DeflectionSource, Deflections> = { gamepad: {}, touch: {} };
  private readonly waitsForRest: Record<DeflectionSource, boolean> = { gamepad: false, touch: false };
  private sent: { held: readonly string[]; deflections: Deflections } = { held: [], deflections: {} };
  private fullDeflection = 1;
  private isDelaying = false;

  /**
   * @param send sends a message to the server.
   * @param changed is called after each change of what this object shows.
   * @param after calls a function after a delay [ms].
   * @param now returns a time that never jumps [ms].
   */
  constructor(
    private readonly send: (message: PageMessage) => void,
    private readonly changed: () => void,
    private readonly after: (call: () => void, delay: number) => void,
    private readonly now: () => number,
  ) {}

  get state(): DrivingState {
    if (!this.mayDrive || this.machine === null) return "unavailable";
    const driver = this.drivers[this.machine];
    if (driver?.is_you) return "driving";
    if (this.isRequested) return "requested";
    return driver ? "taken" : "free";
  }

  get isDriving(): boolean {
    return this.state === "driving";
  }

  /** Machine that is driven or would be. */
  get selectedMachine(): string | null {
    return this.machine;
  }

  /** Identifier of the page that drives the machine; null if nobody does. */
  get driver(): string | null {
    return this.machine === null ? null : (this.drivers[this.machine]?.id ?? null);
  }

  /** Full deflection of a held key, 0.1 to 1. */
  get speed(): number {
    return this.fullDeflection;
  }

  /** Keys that deflect levers now. */
  get heldKeys(): readonly string[] {
    return this.isDriving ? this.held : [];
  }

  /** Deflections by gamepad and touch that are in effect now. */
  get deflections(): Deflections {
    return this.isDriving ? this.merged() : {};
  }

  /** Receive whether the page is connected to a simulation that it may drive. */
  setAvailable(mayDrive: boolean): void {
    if (!mayDrive) {
      this.drivers = {};
      this.isRequested = false;
      this.releaseLevers();
    }
    this.mayDrive = mayDrive;
    this.changed();
  }

  /**
   * Select the machine; control of another one is released.
   *
   * @param isReplacement whether it replaces a machine that has gone: levers do not take control of it, buttons do.
   */
  selectMachine(id: string | null, isReplacement = false): void {
    this.isReplacement = isReplacement;
    if (id === this.machine) return;
    if (this.isDriving || this.isRequested) this.releaseControl();
    this.machine = id;
    this.changed();
  }

  receiveControl(message: ControlMessage): void {
    const wasDriving = this.isDriving;
    this.drivers = { ...message.drivers };
    if (this.isDriving && !wasDriving) this.begin();
    if (!this.isDriving && wasDriving) this.releaseLevers();
    this.changed();
  }

  /** Receive an error; a request that is open has been refused. */
  receiveError(): void {
    if (!this.isRequested) return;
    this.isRequested = false;
    this.changed();
  }

  /** Ask for control; `force` takes it from another page. */
  takeControl(force = false): void {
    const { state, machine } = this;
    if (machine === null || !(state === "free" || (state === "taken" && force))) return;
    this.isRequested = true;
    this.isReplacement = false;
    this.requester = null;
    this.send(force ? { type: "take_control", machine, force } : { type: "take_control", machine });
    this.changed();
  }

  /** Ask for control of a free machine because a lever was deflected; return whether it was asked for. */
  takeControlByLever(): boolean {
    if (this.state !== "free" || this.isReplacement) return false;
    this.takeControl();
    return true;
  }

  releaseControl(): void {
    if (!this.isDriving && !this.isRequested) return;
    this.releaseLevers();
    this.isRequested = false;
    this.send({ type: "release_control" });
    if (this.machine !== null) delete this.drivers[this.machine];
    this.changed();
  }

  /** Receive the held keys that deflect levers. */
  setHeldKeys(held: readonly string[]): void {
    this.held = [...held];
    this.sendIfChanged();
  }

  /**
   * Receive the deflections of the on-screen levers. A finger that deflects a lever from rest takes control of a free
   * machine and moves it, as a lever key does; one that was on a lever before the machine became free does not.
   */
  setTouchDeflections(deflections: Deflections): void {
    const wasAtRest = isAtRest(mergeDeflections(this.sources.touch));
    if (wasAtRest && !isAtRest(mergeDeflections(deflections)) && this.takeControlByLever()) this.requester = "touch";
    this.setDeflections("touch", deflections);
  }

  /**
   * Receive the deflections of a source. A source that is deflected when control begins, or when all levers are
   * released, counts again only after it was in its middle: a hand that rests on a stick does not start the machine.
   * If a deflection of this source asked for control, the source counts from the beginning of control.
   */
  setDeflections(source: DeflectionSource, deflections: Deflections): void {
    if (isAtRest(mergeDeflections(deflections))) this.waitsForRest[source] = false;
    if (areEqual(this.sources[source], deflections)) return;
    this.sources[source] = { ...deflections };
    if (this.isDelaying && !isAtRest(this.merged())) {
      this.changed(); // the newest deflections follow after the delay
      return;
    }
    if (this.sendIfChanged() && !this.isDelaying) this.delay();
  }

  /** Release all levers, as when the window loses the focus. */
  releaseLevers(): void {
    this.held = [];
    this.requireRest();
    this.sendIfChanged();
  }

  /** Set the full deflection of a held key, 0.1 to 1. */
  setSpeed(value: number): void {
    const speed = Math.round(clamp(value, MIN_SPEED, 1) / SPEED_STEP) * SPEED_STEP;
    this.fullDeflection = Number(speed.toFixed(1));
    if (this.isDriving) this.send({ type: "speed", value: this.fullDeflection });
    this.changed();
  }

  /** Change the full deflection by steps of 0.1. */
  changeSpeed(steps: number): void {
    this.setSpeed(this.fullDeflection + steps * SPEED_STEP);
  }

  /** Press or release the emergency stop of the machine; also possible without control. */
  setEmergencyStop(pressed: boolean): void {
    if (this.machine === null) return;
    if (pressed) this.releaseLevers();
    this.send({ type: "emergency_stop", machine: this.machine, pressed });
  }

  /** Send the present levers; to be called every `DRIVE_INTERVAL_MS`. */
  tick(): void {
    if (this.isDriving) this.sendLevers();
  }

  private begin(): void {
    this.isRequested = false;
    this.requireRest(this.requester);
    this.requester = null;
    this.send({ type: "speed", value: this.fullDeflection });
    this.sendLevers();
  }

  /** Ignore each source, except one, that is deflected now until it was released. */
  private requireRest(except: DeflectionSource | null = null): void {
    for (const source of ["gamepad", "touch"] as const) {
      if (source === except) continue;
      this.waitsForRest[source] ||= !isAtRest(mergeDeflections(this.sources[source]));
    }
  }

  private merged(): Deflections {
    const { gamepad, touch } = this.sources;
    return mergeDeflections(this.waitsForRest.gamepad ? {} : gamepad, this.waitsForRest.touch ? {} : touch);
  }

  /** Delay further changes of deflections. */
  private delay(): void {
    this.isDelaying = true;
    this.after(() => {
      this.isDelaying = false;
      if (this.sendIfChanged()) this.delay();
    }, CHANGE_INTERVAL_MS);
  }

  /** Send the levers if they have changed; return whether they were sent. */
  private sendIfChanged(): boolean {
    const isSame =
      areEqual(this.merged(), this.sent.deflections) &&
      this.held.length === this.sent.held.length &&
      this.held.every((name, i) => name === this.sent.held[i]);
    if (isSame) return false;
    const { isDriving } = this;
    if (isDriving) this.sendLevers();
    this.changed();
    return isDriving;
  }

  private sendLevers(): void {
    if (this.machine === null) return;
    this.sent = { held: [...this.held], deflections: this.merged() };
    // The server ignores levers that a stalled connection delivers late.
    this.send({ type: "drive", machine: this.machine, ...this.sent, held: [...this.held], time: this.now() / 1000 });
  }
}
