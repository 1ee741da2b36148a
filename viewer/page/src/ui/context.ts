/** What the parts of the user interface share. */

import type { Deflections } from "../driving/deflections";
import type { DrivingSession } from "../driving/driving_session";
import type { MachineState } from "../world_state";
import type { App } from "./interfaces";
import type { Toasts } from "./toasts";

export interface UiContext {
  readonly app: App;
  readonly session: DrivingSession;
  readonly toasts: Toasts;
  /** Machine whose gauges are shown and that is driven; null before the first. */
  machine(): MachineState | null;
  /** Deflections of levers and pedals by all inputs together. */
  deflections(): Deflections;
  /** Characters of this keyboard by key code, where the browser tells. */
  keyboardLayout(): ReadonlyMap<string, string> | null;
}

/** A part of the user interface; `update` is called about 10 times a second and on changes. */
export interface Part {
  readonly element: HTMLElement;
  update(): void;
}

/** Return whether the page shows a bag. */
export function showsBag(app: App): boolean {
  return app.world.hello?.source === "bag";
}

/** Return the name of a machine for the user. */
export function machineName(machine: MachineState): string {
  const name = machine.id.replace(/^\/+/, "") || machine.message.model.name;
  return name.replaceAll("_", " ");
}
