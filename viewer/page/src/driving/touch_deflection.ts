/** Deflection of an on-screen lever from the position of the finger. */

import { clamp } from "../clamp";
import { beyondDeadZone } from "./deflections";

/** Share of the travel around the middle in which a lever is released. */
const DEAD_ZONE = 0.1;

/** A motion mostly along one axis does not deflect the other one: share of the larger deflection that is ignored. */
const CROSS_AXIS_SHARE = 0.25;

/**
 * Return the deflections of a lever, positive to the left and forward (up).
 *
 * @param dx position of the finger to the right of the middle [px].
 * @param dy position below the middle [px].
 * @param radius travel of the lever [px].
 */
export function leverDeflection(dx: number, dy: number, radius: number): { x: number; y: number } {
  const distance = Math.hypot(dx, dy);
  const scale = distance > radius ? 1 / distance : 1 / radius;
  const x = -dx * scale;
  const y = -dy * scale;
  const crossZone = Math.max(DEAD_ZONE, CROSS_AXIS_SHARE * Math.max(Math.abs(x), Math.abs(y)));
  const isAlongX = Math.abs(x) > Math.abs(y);
  return {
    x: beyondDeadZone(x, isAlongX ? DEAD_ZONE : crossZone),
    y: beyondDeadZone(y, isAlongX ? crossZone : DEAD_ZONE),
  };
}

/** Return the deflection of a pedal, positive forward (up); `dy` and `travel` in [px]. */
export function pedalDeflection(dy: number, travel: number): number {
  return beyondDeadZone(clamp(-dy / travel, -1, 1), DEAD_ZONE);
}
