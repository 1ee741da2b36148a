/** A camera that circles around the machine and moves with it. */

import { Vector3 } from "three";
import { clamp } from "../clamp";
import { lookAt } from "./look_at";
import type { CameraPose, CameraView, ViewContext } from "./view";

/** Height of the point looked at above the base [m]. */
const LOOK_HEIGHT = 1.6;

/** Least height of the camera above the ground [m]. */
const CLEARANCE = 0.5;

/** Time in which the camera approaches the machine's position to 1/e [s]. */
const FOLLOW_TIME = 0.25;

const INITIAL: OrbitPosition = { azimuth: -1.02, elevation: 0.3, distance: 13.5 };

/** Direction from the machine to the camera [rad], azimuth from +x counterclockwise, and distance [m]. */
export interface OrbitPosition {
  azimuth: number;
  elevation: number;
  distance: number;
}

export class OrbitView implements CameraView {
  private azimuth: number;
  private elevation: number;
  private distance: number;
  private readonly offset = new Vector3(); // of the point looked at from the machine
  private readonly center = new Vector3();
  private followed: object | null = null;

  constructor(initial: Partial<OrbitPosition> = {}) {
    ({ azimuth: this.azimuth, elevation: this.elevation, distance: this.distance } = { ...INITIAL, ...initial });
  }

  update({ machine, terrain, aspect, dt }: ViewContext, pose: CameraPose): void {
    const base = machine && machine.state.frames > 0 ? machine : null;
    if (base) {
      const isNew = this.followed !== base || this.center.distanceTo(base.basePosition) > 6;
      const share = isNew ? 1 : 1 - Math.exp(-dt / FOLLOW_TIME);
      this.center.lerp(base.basePosition, share);
      this.followed = base;
    } else if (terrain && !this.followed) {
      this.center.set(0, 0, terrain.heightAt(0, 0));
    }
    const { focus, position } = pose;
    focus.copy(this.center).add(this.offset);
    focus.z += LOOK_HEIGHT;
    if (terrain) focus.z = Math.max(focus.z, terrain.heightAt(focus.x, focus.y) + 0.2);
    const level = Math.cos(this.elevation) * this.distance;
    position.set(Math.cos(this.azimuth) * level, Math.sin(this.azimuth) * level, Math.sin(this.elevation) * this.distance);
    position.multiplyScalar(aspect < 1 ? Math.min(1 / aspect, 1.6) : 1).add(focus);
    if (terrain) {
      // The ground a step around counts too, so that the near plane does not cut a crest.
      let ground = terrain.heightAt(position.x, position.y);
      for (const [dx, dy] of AROUND) ground = Math.max(ground, terrain.heightAt(position.x + dx, position.y + dy));
      position.z = Math.max(position.z, ground + CLEARANCE);
    }
    lookAt(pose.rotation, position, focus);
    pose.fov = 42;
    pose.near = 0.1;
  }

  drag(dx: number, dy: number): void {
    this.azimuth -= 3.2 * dx;
    this.elevation = clamp(this.elevation + 2.4 * dy, -0.15, 1.5);
  }

  pan(dx: number, dy: number): void {
    const scale = 0.9 * this.distance;
    const sin = Math.sin(this.azimuth);
    const cos = Math.cos(this.azimuth);
    this.offset.x += scale * (dx * sin - dy * cos);
    this.offset.y += scale * (-dx * cos - dy * sin);
    this.offset.clampLength(0, 60);
  }

  zoom(factor: number): void {
    this.distance = clamp(this.distance * factor, 2.5, 160);
  }
}

const AROUND = [
  [0.3, 0],
  [-0.3, 0],
  [0, 0.3],
  [0, -0.3],
] as const;
