/** Gauges of the selected machine. */

import { clamp } from "../clamp";
import type { MachineMessage } from "../protocol";
import type { MachineState } from "../world_state";
import { BarRow, ValueRow } from "./bars";
import { machineName, showsBag, type Part, type UiContext } from "./context";
import { make, setAttribute, setShown, setText } from "./dom";
import { degrees, formatInteger, formatName, formatNumber, formatValue, UNKNOWN, wrapAngle } from "./format";
import { OtherPayloads, showPayload } from "./other_payloads";

/** Full scale of the pressures if the machine does not state its relief pressures [Pa]. */
const PRESSURE_SCALE = 35e6;

/** A joint or a pressure this near to its limit is marked: share of the range. */
const LIMIT_SHARE = 0.02;

/** Tilt from which a machine is marked [rad]; crawler excavators are not meant to dig beyond it. */
const TILT_WARNING = 0.26;

/** Joints that a machine without levers does not show: virtual ones of the base, wheels, and parts of cylinders. */
const HIDDEN_JOINT = /^base_(x|y|z|yaw|pitch|roll)$|(^|_)(barrel|rod|rocker|coupler|sprocket|idler|cylinder)(_|$)/;

export class MachineSection implements Part {
  private readonly name = make("span", { "data-testid": "machine-name" });
  private readonly driver = new ValueRow("Driver", "machine-driver");
  private readonly stop = new ValueRow(
    "Emergency stop",
    "machine-stopped",
    "As the machine reports it in its diagnostics; a recording without them has it from its first press",
  );
  private readonly phase = new ValueRow("Operator", "machine-phase", "Phase of the automatic operator");
  private readonly speed = new ValueRow("Travel", "machine-speed");
  private readonly tilt = new ValueRow("Pitch, roll", "machine-tilt", "Nose down and right side down are positive");
  private readonly load = new BarRow("Engine", "machine-load", ["plain"]);
  private readonly payload = new BarRow("Payload", "payload-fill", ["payload"]);
  private readonly others: OtherPayloads;
  private readonly payloadMass = new ValueRow("", "payload-mass");
  private readonly tracks: readonly [BarRow, BarRow] = [
    new BarRow("Left track", "track-left", ["centered"]),
    new BarRow("Right track", "track-right", ["centered"]),
  ];
  private readonly jointList = make("div", { class: "rows", "data-testid": "joints" });
  private readonly cylinderList = make("div", { class: "rows", "data-testid": "cylinders" });
  private readonly joints = new Map<string, BarRow>();
  private readonly cylinders = new Map<string, BarRow>();
  private readonly cylinderTitle = make("h3", {}, "Cylinders ", make("small", {}, "cap / rod side"));
  private shown: MachineMessage | null = null;
  private readonly none = make("p", { class: "hint" }, "No machine.");
  private readonly content = make("div", { class: "rows" });
  readonly element = make(
    "details",
    { class: "section", open: true, "data-testid": "section-machine" },
    make("summary", {}, make("h2", {}, this.name)),
    this.none,
    this.content,
  );

  constructor(private readonly context: UiContext) {
    this.others = new OtherPayloads(context);
    this.content.append(
      this.driver.element,
      this.stop.element,
      this.phase.element,
      make("div", { class: "rows" }, this.payload.element, this.payloadMass.element),
      this.load.element,
      this.others.element,
      make("h3", {}, "Joints"),
      this.jointList,
      make("h3", {}, "Tracks"),
      this.tracks[0].element,
      this.tracks[1].element,
      this.speed.element,
      this.tilt.element,
      this.cylinderTitle,
      this.cylinderList,
    );
  }

  update(): void {
    const machine = this.context.machine();
    setShown(this.none, machine === null);
    setShown(this.content, machine !== null);
    setText(this.name, machine === null ? "Machine" : formatName(machineName(machine)));
    if (machine === null) return;
    if (machine.message !== this.shown) this.show(machine.message);
    this.updateState(machine);
    this.updatePayload(machine);
    this.others.update();
    for (const [name, row] of this.joints) updateJoint(row, machine, name);
    this.updateTracks(machine);
    for (const [name, row] of this.cylinders) updateCylinder(row, machine, name);
  }

  /** Make the rows of a machine's joints. */
  private show(message: MachineMessage): void {
    this.shown = message;
    this.joints.clear();
    this.cylinders.clear();
    this.jointList.replaceChildren();
    this.cylinderList.replaceChildren();
    const { levers, model } = message;
    const { full, relief } = pressureScale(message);
    this.cylinderTitle.title =
      `Pressures of the cap side (above) and the rod side; full scale ${formatNumber(full / 1e6, 1)} MPa,` +
      ` marked from ${formatNumber(relief / 1e6, 1)} MPa`;
    const hasLevers = model.joints.some(({ name }) => name in levers);
    for (const joint of model.joints) {
      if (joint.type === "fixed" || joint.mimic !== undefined) continue;
      if (hasLevers ? !(joint.name in levers) : HIDDEN_JOINT.test(joint.name)) continue;
      const isEndless = joint.lower === null || joint.upper === null || joint.type === "continuous";
      const row = new BarRow(formatName(joint.name), `joint-${joint.name}`, [isEndless ? "mark endless" : "mark"]);
      this.joints.set(joint.name, row);
      this.jointList.append(row.element);
    }
  }

  private updateState(machine: MachineState): void {
    const driver = this.context.app.world.drivers[machine.id];
    setShown(this.driver.element, !showsBag(this.context.app));
    this.driver.setValue(driver === undefined ? "nobody" : driver.is_you ? "you" : `viewer ${driver.id}`);
    const { stopped, stop_requested, phase } = machine.gauges;
    const reported = stopped === true ? "PRESSED" : stopped === false ? "released" : "not reported";
    this.stop.setValue(stop_requested === true ? "requested" : reported);
    setAttribute(this.stop.element, "data-danger", stopped === true);
    this.phase.setValue(phase || UNKNOWN);
    const [pitch, roll] = tiltOf(machine);
    this.tilt.setValue(`${formatNumber(degrees(pitch), 1)}° · ${formatNumber(degrees(roll), 1)}°`);
    setAttribute(this.tilt.element, "data-warning", Math.hypot(pitch ?? 0, roll ?? 0) > TILT_WARNING);
    this.load.setFill(0, machine.load);
    this.load.setValue(formatValue(100 * machine.load, 0, "%"));
  }

  private updatePayload(machine: MachineState): void {
    const { payload } = machine.gauges;
    setShown(this.payload.element, payload !== undefined);
    setShown(this.payloadMass.element, payload !== undefined);
    if (payload === undefined) return;
    showPayload(this.payload, payload.fill);
    this.payloadMass.setValue(`${formatInteger(payload.mass)} kg · ${formatValue(payload.bank_m3, 2, "m³ bank")}`);
  }

  private updateTracks(machine: MachineState): void {
    const { model } = machine.message;
    const names = ["left", "right"] as const;
    names.forEach((side, i) => {
      const speed = trackSpeed(machine, side);
      const row = this.tracks[i];
      if (row === undefined) return;
      row.setCentered(0, (speed ?? 0) / 2);
      row.setValue(formatValue(speed, 2, "m/s"));
    });
    setShown(this.tracks[0].element, model.tracks.length > 0 || trackSpeed(machine, "left") !== undefined);
    setShown(this.tracks[1].element, model.tracks.length > 0 || trackSpeed(machine, "right") !== undefined);
    this.speed.setValue(formatValue(machine.gauges.speed, 2, "m/s"));
    const cylinders = machine.gauges.cylinders ?? {};
    for (const name of Object.keys(cylinders)) {
      if (this.cylinders.has(name)) continue;
      const row = new BarRow(formatName(name), `cylinder-${name}`, ["cap", "rod"]);
      this.cylinders.set(name, row);
      this.cylinderList.append(row.element);
    }
    setShown(this.cylinderTitle, this.cylinders.size > 0);
  }
}

function updateJoint(row: BarRow, machine: MachineState, name: string): void {
  const index = machine.message.model.joints.findIndex((each) => each.name === name);
  const joint = machine.message.model.joints[index];
  if (joint === undefined) return;
  const value = machine.gauges.joints?.[name] ?? machine.positions[index] ?? 0;
  const { lower, upper } = joint;
  if (joint.type === "prismatic") row.setValue(formatValue(value, 2, "m"));
  if (lower === null || upper === null || joint.type === "continuous") {
    const angle = wrapAngle(value);
    row.setMark(0, 0.5 - angle / (2 * Math.PI)); // positive is to the left
    row.setValue(`${formatNumber(degrees(angle), 1)}°`);
    return;
  }
  const share = (value - lower) / (upper - lower);
  row.setMark(0, share, share < LIMIT_SHARE || share > 1 - LIMIT_SHARE);
  if (joint.type !== "prismatic") row.setValue(`${formatNumber(degrees(value), 1)}°`);
}

function updateCylinder(row: BarRow, machine: MachineState, name: string): void {
  const cylinder = machine.gauges.cylinders?.[name];
  if (cylinder === undefined) {
    row.setFill(0, 0);
    row.setFill(1, 0);
    row.setValue(UNKNOWN);
    return;
  }
  const { cap, rod } = cylinder;
  const { full, relief } = pressureScale(machine.message);
  row.setFill(0, cap / full, cap > (1 - LIMIT_SHARE) * relief);
  row.setFill(1, rod / full, rod > (1 - LIMIT_SHARE) * relief);
  row.setValue(`${formatNumber(cap / 1e6, 1)} / ${formatNumber(rod / 1e6, 1)} MPa`);
}

/** Return the full scale of pressures, which locked cylinders reach, and the maximum of moving ones [Pa]. */
export function pressureScale({ model }: Pick<MachineMessage, "model">): { full: number; relief: number } {
  const { main_relief_pressure: main = PRESSURE_SCALE, port_relief_pressure: port = PRESSURE_SCALE } = model.hydraulics ?? {};
  return { full: Math.max(main, port), relief: main };
}

/** Return the speed of a track [m/s], from its sprocket or from the command in effect. */
function trackSpeed(machine: MachineState, side: "left" | "right"): number | undefined {
  const { model } = machine.message;
  const track = model.tracks.find((each) => each.joint.includes(side));
  const index = track === undefined ? -1 : model.joints.findIndex((joint) => joint.name === track.joint);
  const velocity = machine.velocities[index];
  if (track !== undefined && velocity !== undefined) return velocity * track.radius;
  return machine.gauges.applied?.[`${side}_track`];
}

/** Return pitch and roll of the base [rad]. */
function tiltOf(machine: MachineState): readonly [number | undefined, number | undefined] {
  if (machine.base !== null) {
    const [, , , x, y, z, w] = machine.base;
    const pitch = Math.asin(clamp(2 * (w * y - z * x), -1, 1));
    return [pitch, Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))];
  }
  const value = (name: string): number | undefined => {
    const index = machine.message.model.joints.findIndex((joint) => joint.name === name);
    return index < 0 ? undefined : machine.positions[index];
  };
  return [value("base_pitch"), value("base_roll")];
}
