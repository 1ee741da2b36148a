/**
 * Deflections of the levers and pedals, -1 to 1: levers positive to the left and forward, pedals forward, as in
 * `teleop/key_layout.py`.
 */

import { clamp } from "../clamp";

export const CONTROLS = ["left_x", "left_y", "right_x", "right_y", "left_pedal", "right_pedal"] as const;

export type Control = (typeof CONTROLS)[number];

/** Deflection by control; a control that is missing is in its middle. */
export type Deflections = Partial<Record<Control, number>>;

/** Step of the deflections that are sent: less than a hand can hold still, and no message for noise. */
const RESOLUTION = 0.01;

/** Return the sum of deflections, limited to -1 to 1 and rounded to steps of 0.01; without controls in their middle. */
export function mergeDeflections(...parts: readonly Deflections[]): Deflections {
  const merged: Deflections = {};
  for (const control of CONTROLS) {
    let sum = 0;
    for (const part of parts) sum += part[control] ?? 0;
    const value = Math.round(clamp(sum, -1, 1) / RESOLUTION) * RESOLUTION;
    if (Math.abs(value) >= RESOLUTION / 2) merged[control] = Number(value.toFixed(2));
  }
  return merged;
}

/** Return the deflections of held keys at a full deflection of `speed`; opposite keys cancel each other. */
export function keyDeflections(
  held: Iterable<string>,
  keys: Readonly<Record<string, Readonly<Record<string, number>>>>,
  speed: number,
): Deflections {
  const sums: Record<string, number> = {};
  for (const name of held) {
    for (const [control, sign] of Object.entries(keys[name] ?? {})) sums[control] = (sums[control] ?? 0) + sign;
  }
  const deflections: Deflections = {};
  for (const control of CONTROLS) {
    const sum = sums[control] ?? 0;
    if (sum !== 0) deflections[control] = Math.sign(sum) * speed;
  }
  return deflections;
}

/** Return whether two sets of deflections are the same. */
export function areEqual(a: Deflections, b: Deflections): boolean {
  return CONTROLS.every((control) => (a[control] ?? 0) === (b[control] ?? 0));
}

/** Return whether every lever and pedal is in its middle. */
export function isAtRest(deflections: Deflections): boolean {
  return areEqual(deflections, {});
}

/** Return a deflection without the zone around the middle; it begins at 0 beyond the zone and reaches 1 at the end. */
export function beyondDeadZone(value: number, zone: number): number {
  const size = Math.abs(value);
  if (!(size > zone)) return 0;
  return Math.sign(value) * Math.min((size - zone) / (1 - zone), 1);
}
