/** A machine in the scene: links and joints as a tree, shapes, tracks, and motion between frames. */

import { Group, Quaternion, Vector3, type Object3D } from "three";
import type { Joint } from "../protocol";
import type { MachineState } from "../world_state";
import { SmoothValues } from "./joint_motion";
import { TrackShoes } from "./track_shoes";
import { decodeParts, disposeTree, placeAt, visualObject } from "./visuals";

/** A joint that moves, and what it moves. */
interface MovingJoint {
  index: number;
  isPrismatic: boolean;
  object: Object3D;
  axis: Vector3;
  /** Pose at the value 0. */
  position: Vector3;
  rotation: Quaternion;
}

interface Mimicry {
  index: number;
  source: number;
  multiplier: number;
  offset: number;
}

/** Time in which the shown attitude approaches that of the frame to 1/e [s]. */
const ATTITUDE_TIME = 0.05;

export class MachineView {
  readonly root = new Group();
  readonly links = new Map<string, Object3D>();
  /** Position and yaw of the base, for cameras and shadows; updated by `update`. */
  readonly basePosition = new Vector3();
  baseYaw = 0;
  private readonly moving: MovingJoint[] = [];
  private readonly mimicries: Mimicry[] = [];
  private readonly tracks: { shoes: TrackShoes; index: number }[] = [];
  private readonly joints: SmoothValues;
  private readonly base = new SmoothValues(3);
  private readonly baseVelocity = [0, 0, 0];
  private readonly baseAttitude = new Quaternion();
  private lastBase: { time: number; position: [number, number, number] } | null = null;
  private seenFrames = 0;
  private readonly turn = new Quaternion();
  private readonly shift = new Vector3();

  constructor(readonly state: MachineState) {
    const { model } = state.message;
    this.root.name = state.id;
    this.joints = new SmoothValues(model.joints.length);
    for (const link of model.links) {
      const object = new Group();
      object.name = link.name;
      for (const visual of link.visuals) object.add(visualObject(visual));
      this.links.set(link.name, object);
    }
    const children = new Set(model.joints.map((joint) => joint.child));
    for (const [name, object] of this.links) if (!children.has(name)) this.root.add(object);
    model.joints.forEach((joint, index) => this.addJoint(joint, index));
    for (const track of model.tracks) {
      const index = model.joints.findIndex((joint) => joint.name === track.joint);
      const shoes = new TrackShoes(track, model.joints[index]);
      this.links.get(track.link)?.add(shoes.group);
      this.tracks.push({ shoes, index });
    }
    if (!model.shoe) return;
    decodeParts(model.shoe, (parts) => {
      for (const { shoes } of this.tracks) shoes.setParts(parts);
    });
  }

  get id(): string {
    return this.state.id;
  }

  /** Return a link by its name; names of links may have a prefix. */
  findLink(name: string): Object3D | undefined {
    const exact = this.links.get(name);
    if (exact) return exact;
    for (const [key, link] of this.links) if (key.endsWith(`/${name}`) || key.endsWith(`_${name}`)) return link;
    return undefined;
  }

  /** Link that stands on the ground: the one with the tracks, or else the first. */
  get baseLink(): Object3D {
    const { tracks, links } = this.state.message.model;
    return this.links.get(tracks[0]?.link ?? "base_link") ?? this.links.get(links[0]?.name ?? "") ?? this.root;
  }

  /** Move to the state at a time. `rate` is simulated time for each second, 0 while paused. */
  update(now: number, dt: number, rate: number): void {
    const { state } = this;
    if (state.frames === 0) {
      this.root.visible = false;
      return;
    }
    this.root.visible = true;
    if (state.frames !== this.seenFrames) this.receive();
    const age = ((now - state.receivedAt) / 1000) * rate;
    this.joints.update(age, dt);
    const values = this.joints.shown;
    for (const { index, source, multiplier, offset } of this.mimicries) {
      values[index] = multiplier * values[source]! + offset;
    }
    for (const joint of this.moving) this.moveJoint(joint, values[joint.index]!);
    for (const { shoes, index } of this.tracks) if (index >= 0) shoes.setAngle(values[index]!);
    if (state.base) {
      this.base.update(age, dt);
      const [x, y, z] = this.base.shown;
      this.root.position.set(x!, y!, z!);
      this.root.quaternion.slerp(this.baseAttitude, 1 - Math.exp(-dt / ATTITUDE_TIME));
    }
    this.root.updateMatrixWorld();
    const { elements } = this.baseLink.matrixWorld;
    this.basePosition.setFromMatrixPosition(this.baseLink.matrixWorld);
    this.baseYaw = Math.atan2(elements[1]!, elements[0]!);
  }

  /** Take the values of the newest frame. */
  private receive(): void {
    const { state } = this;
    const isFirst = this.seenFrames === 0;
    this.seenFrames = state.frames;
    this.joints.receive(state.positions, state.velocities);
    if (!state.base) return;
    const [x, y, z, qx, qy, qz, qw] = state.base;
    const last = this.lastBase;
    const elapsed = last ? state.time - last.time : 0;
    [x, y, z].forEach((value, i) => {
      this.baseVelocity[i] = last && elapsed > 0 && elapsed < 0.5 ? (value - last.position[i]!) / elapsed : 0;
    });
    if (elapsed !== 0 || !last) this.lastBase = { time: state.time, position: [x, y, z] };
    this.base.receive([x, y, z], this.baseVelocity);
    this.baseAttitude.set(qx, qy, qz, qw);
    if (isFirst) this.root.quaternion.copy(this.baseAttitude);
  }

  private addJoint(joint: Joint, index: number): void {
    const parent = this.links.get(joint.parent) ?? this.root; // `map` may have no link
    const child = this.links.get(joint.child);
    if (!child) return;
    placeAt(child, joint.origin);
    parent.add(child);
    if (joint.type === "fixed") return;
    this.moving.push({
      index,
      isPrismatic: joint.type === "prismatic",
      object: child,
      axis: new Vector3(...joint.axis).normalize(),
      position: child.position.clone(),
      rotation: child.quaternion.clone(),
    });
    if (!joint.mimic) return;
    const { joint: name, multiplier, offset } = joint.mimic;
    const source = this.state.message.model.joints.findIndex((other) => other.name === name);
    if (source >= 0) this.mimicries.push({ index, source, multiplier, offset });
  }

  private moveJoint(joint: MovingJoint, value: number): void {
    if (joint.isPrismatic) {
      this.shift.copy(joint.axis).multiplyScalar(value).applyQuaternion(joint.rotation);
      joint.object.position.copy(joint.position).add(this.shift);
    } else {
      joint.object.quaternion.copy(joint.rotation).multiply(this.turn.setFromAxisAngle(joint.axis, value));
    }
  }

  dispose(): void {
    this.root.removeFromParent();
    disposeTree(this.root);
  }
}
