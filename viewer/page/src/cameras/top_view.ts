/** A plan of the site, from high above with little perspective; +y of the map is up. */

import { MathUtils, Vector3 } from "three";
import { clamp } from "../clamp";
import { lookAt } from "./look_at";
import type { CameraPose, CameraView, ViewContext } from "./view";

const FIELD = 20;
const UP = new Vector3(0, 1, 0);
const FOLLOW_TIME = 0.4;

export class TopView implements CameraView {
  private readonly offset = new Vector3();
  private readonly center = new Vector3();
  private followed: object | null = null;

  /** @param length of the ground that fits into the smaller side of the picture [m]; 0: the whole map, at most 60 m. */
  constructor(private length = 0) {}

  update({ machine, terrain, aspect, dt }: ViewContext, pose: CameraPose): void {
    if (this.length === 0 && terrain) this.length = Math.min(1.08 * Math.max(terrain.rows, terrain.cols) * terrain.cell, 60);
    const length = this.length || 40;
    if (machine && machine.state.frames > 0) {
      this.center.lerp(machine.basePosition, this.followed === machine ? 1 - Math.exp(-dt / FOLLOW_TIME) : 1);
      this.followed = machine;
    }
    pose.focus.copy(this.center).add(this.offset);
    if (terrain) this.keepMapInView(terrain.rows * terrain.cell, terrain.cols * terrain.cell, length, pose.focus);
    const height = (0.5 * length) / Math.tan(MathUtils.degToRad(FIELD / 2)) / Math.min(aspect, 1);
    pose.position.copy(pose.focus).z += height;
    lookAt(pose.rotation, pose.position, pose.focus, UP);
    pose.fov = FIELD;
    pose.near = 1;
  }

  /** Move the middle toward that of the map as far as its border would be within the picture. */
  private keepMapInView(sizeX: number, sizeY: number, length: number, focus: Vector3): void {
    if (this.offset.lengthSq() > 0) return; // the user moved it
    const reachX = Math.max(0.5 * (sizeX - length), 0);
    const reachY = Math.max(0.5 * (sizeY - length), 0);
    focus.x = clamp(focus.x, -reachX, reachX);
    focus.y = clamp(focus.y, -reachY, reachY);
  }

  drag(dx: number, dy: number): void {
    const scale = this.length || 40;
    this.offset.x -= scale * dx;
    this.offset.y += scale * dy;
  }

  pan(dx: number, dy: number): void {
    this.drag(dx, dy);
  }

  zoom(factor: number): void {
    this.length = clamp((this.length || 40) * factor, 6, 400);
  }
}
