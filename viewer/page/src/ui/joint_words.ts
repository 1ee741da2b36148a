/** Words for the motion that a direction of a lever causes. */

import type { MachineMessage } from "../protocol";
import type { Control } from "../driving/deflections";

/** What is read of a machine. */
export interface LeverAssignment {
  readonly levers: MachineMessage["levers"];
  readonly model: { readonly joints: readonly Pick<MachineMessage["model"]["joints"][number], "name" | "type" | "axis">[] };
}

/** Positive and negative motion of joints whose words do not follow from their axis. */
const JOINT_WORDS: Readonly<Record<string, readonly [string, string]>> = {
  swing: ["swing left", "swing right"],
  arm: ["arm in", "arm out"],
  bucket: ["bucket curl in", "bucket dump"],
  turn: ["turn left", "turn right"],
  lift: ["boom down", "boom up"],
  head: ["head forward", "head backward"],
  bed: ["bed down", "bed tip"],
};

/** Return words for the motion of a joint in its positive (1) or negative (-1) direction. */
function motionWords(name: string, axis: readonly number[], sign: number): string {
  const words = JOINT_WORDS[name] ?? axisWords(name, axis);
  return words[sign > 0 ? 0 : 1];
}

/** Return the motion that a direction of a control causes; empty if it moves nothing. */
export function controlWords(machine: LeverAssignment, control: Control, direction: 1 | -1): string {
  if (control === "left_pedal") return direction > 0 ? "left track forward" : "left track back";
  if (control === "right_pedal") return direction > 0 ? "right track forward" : "right track back";
  const words: string[] = [];
  for (const [name, label] of Object.entries(machine.levers)) {
    const isReversed = label.startsWith("-");
    if (label.replace(/^[-+]/, "") !== control) continue;
    const axis = machine.model.joints.find((joint) => joint.name === name)?.axis ?? [0, 1, 0];
    words.push(motionWords(name, axis, isReversed ? -direction : direction));
  }
  return words.join(", ");
}

function axisWords(name: string, axis: readonly number[]): readonly [string, string] {
  const label = name.replaceAll("_", " ");
  // Right-hand rule: about +z positive turns left, about +y positive lowers.
  const [x = 0, y = 0, z = 0] = axis;
  if (Math.abs(z) > Math.max(Math.abs(x), Math.abs(y))) {
    return z > 0 ? [`${label} left`, `${label} right`] : [`${label} right`, `${label} left`];
  }
  return y >= 0 ? [`${label} down`, `${label} up`] : [`${label} up`, `${label} down`];
}
