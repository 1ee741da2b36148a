/**
 * Deflections from a gamepad with the standard mapping of the Gamepad API: the sticks are the two levers, the triggers
 * drive the tracks forward and the shoulder buttons backward.
 */

import { beyondDeadZone, type Deflections } from "./deflections";

/** What is read of a `Gamepad`. */
export interface GamepadInput {
  readonly axes: readonly number[];
  readonly buttons: readonly { readonly pressed: boolean; readonly value: number }[];
}

/** Zone around the middle of a stick in which it counts as released; worn sticks rest within it. */
const STICK_DEAD_ZONE = 0.12;
const TRIGGER_DEAD_ZONE = 0.05;

/** Indices of the standard mapping. */
const BUTTON = { east: 1, leftShoulder: 4, rightShoulder: 5, leftTrigger: 6, rightTrigger: 7, start: 9 } as const;

/** Return the deflections; the axes of the API are positive to the right and to the rear. */
export function gamepadDeflections(pad: GamepadInput): Deflections {
  return {
    left_x: -axis(pad, 0),
    left_y: -axis(pad, 1),
    right_x: -axis(pad, 2),
    right_y: -axis(pad, 3),
    left_pedal: pedal(pad, BUTTON.leftTrigger, BUTTON.leftShoulder),
    right_pedal: pedal(pad, BUTTON.rightTrigger, BUTTON.rightShoulder),
  };
}

/** Return whether the button of the emergency stop (B, circle) is pressed. */
export function isStopPressed(pad: GamepadInput): boolean {
  return pad.buttons[BUTTON.east]?.pressed ?? false;
}

/** Return whether the button that takes control (start, menu) is pressed. */
export function isStartPressed(pad: GamepadInput): boolean {
  return pad.buttons[BUTTON.start]?.pressed ?? false;
}

function axis(pad: GamepadInput, index: number): number {
  return beyondDeadZone(pad.axes[index] ?? 0, STICK_DEAD_ZONE);
}

function pedal(pad: GamepadInput, trigger: number, shoulder: number): number {
  const backward = pad.buttons[shoulder]?.pressed ? 1 : 0;
  return beyondDeadZone(pad.buttons[trigger]?.value ?? 0, TRIGGER_DEAD_ZONE) - backward;
}
