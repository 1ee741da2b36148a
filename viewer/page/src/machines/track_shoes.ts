/** The shoes of a crawler track: instances of one shoe, moved around the loop by the angle of the sprocket. */

import {
  BoxGeometry,
  Group,
  InstancedBufferAttribute,
  InstancedMesh,
  Matrix4,
  Mesh,
  Vector3,
  type BufferGeometry,
  type Material,
} from "three";
import type { Joint, Track } from "../protocol";
import { paint } from "./visuals";

export class TrackShoes {
  readonly group = new Group();
  /** Poses of the shoes, shared by the parts of a shoe. */
  private readonly poses: InstancedBufferAttribute;
  private readonly loop: number;
  private readonly axle: Vector3;
  private readonly matrix = new Matrix4();
  private shownTravel = NaN;

  /** @param sprocket joint of the sprocket; it gives the height of the axles. */
  constructor(
    private readonly track: Track,
    sprocket: Joint | undefined,
  ) {
    this.loop = 2 * track.axle_distance + 2 * Math.PI * track.radius;
    const height = sprocket ? sprocket.origin.xyz[2] : track.radius + 0.5 * track.shoe_size[2];
    const middle = sprocket ? sprocket.origin.xyz[0] + Math.sign(-sprocket.origin.xyz[0]) * 0.5 * track.axle_distance : 0;
    this.axle = new Vector3(middle, track.y, height);
    this.poses = new InstancedBufferAttribute(new Float32Array(16 * track.shoe_count), 16);
    this.group.name = `shoes of ${track.joint}`;
    this.setAngle(0);
    const plate = new Mesh<BufferGeometry, Material>(new BoxGeometry(...track.shoe_size), paint(track.color, 0.62, 0.55));
    this.setParts([plate]); // until the mesh of a shoe is decoded, if there is one
  }

  /** Draw shoes that consist of these parts. */
  setParts(parts: readonly Mesh<BufferGeometry, Material>[]): void {
    for (const { geometry, material } of this.group.children as InstancedMesh<BufferGeometry, Material>[]) {
      geometry.dispose();
      material.dispose();
    }
    this.group.clear();
    for (const { geometry, material } of parts) {
      const mesh = new InstancedMesh(geometry, material, this.track.shoe_count);
      mesh.instanceMatrix = this.poses;
      mesh.castShadow = mesh.receiveShadow = true;
      mesh.frustumCulled = false;
      this.group.add(mesh);
    }
  }

  /** Move the shoes to an angle of the sprocket [rad]; a positive one drives forward. */
  setAngle(angle: number): void {
    const travel = angle * this.track.radius;
    if (travel === this.shownTravel) return;
    this.shownTravel = travel;
    const pitch = this.loop / this.track.shoe_count;
    const offset = ((travel % pitch) + pitch) % pitch; // all shoes are alike
    for (let k = 0; k < this.track.shoe_count; k++) {
      this.placeShoe(k * pitch + offset);
      this.matrix.toArray(this.poses.array, 16 * k);
    }
    this.poses.needsUpdate = true;
  }

  /** Compute the pose of a shoe at a distance along the loop [m], from the rear end of the upper run forward. */
  private placeShoe(s: number): void {
    const { axle_distance: length, radius } = this.track;
    const half = 0.5 * length;
    const arc = Math.PI * radius;
    let x: number;
    let z: number;
    let pitch: number; // of the shoe about y
    s %= this.loop;
    if (s < length) {
      [x, z, pitch] = [s - half, radius, 0];
    } else if (s < length + arc) {
      pitch = (s - length) / radius;
      [x, z] = [half + radius * Math.sin(pitch), radius * Math.cos(pitch)];
    } else if (s < 2 * length + arc) {
      [x, z, pitch] = [half - (s - length - arc), -radius, Math.PI];
    } else {
      pitch = Math.PI + (s - 2 * length - arc) / radius;
      [x, z] = [-half + radius * Math.sin(pitch), radius * Math.cos(pitch)];
    }
    this.matrix.makeRotationY(pitch).setPosition(this.axle.x + x, this.axle.y, this.axle.z + z);
  }
}
