/**
 * Level of detail of the ground: a quadtree of square patches around the map, whose vertices lie the closer together
 * the nearer the camera is. The vertices of a patch move onto those of the next coarser level toward the end of its
 * range (continuous distance-dependent level of detail), so that neighbours fit without cracks.
 */

import {
  Box3,
  DynamicDrawUsage,
  Frustum,
  InstancedBufferAttribute,
  InstancedBufferGeometry,
  Float32BufferAttribute,
  Matrix4,
  Sphere,
  Vector3,
  type Camera,
} from "three";

/** Quads along a side of a patch; even, so that each second vertex belongs to the coarser level. */
const PATCH_QUADS = 16;

/** Half of the side of the ground [m]. */
const HALF_GROUND = 1500;

const MAX_PATCHES = 4096;

export interface PatchParameters {
  /** Distance of vertices in the finest level [m]. */
  step: number;
  /** Distance from the camera to which the finest level reaches [m]. */
  range: number;
  /** Position of a vertex [m]. */
  origin: { x: number; y: number };
  /** Elevations that are expected [m]; patches outside of the view are left out. */
  bounds: { low: number; high: number };
}

/** Instances of one pass: x, y of the corner, distance of vertices [m], level. */
class PatchList {
  readonly geometry = new InstancedBufferGeometry();
  private readonly values = new Float32Array(4 * MAX_PATCHES);
  private readonly attribute = new InstancedBufferAttribute(this.values, 4);
  count = 0;

  constructor() {
    const n = PATCH_QUADS;
    const positions: number[] = [];
    const index: number[] = [];
    for (let y = 0; y <= n; y++) for (let x = 0; x <= n; x++) positions.push(x, y, 0);
    for (let y = 0; y < n; y++) {
      for (let x = 0; x < n; x++) {
        const i = y * (n + 1) + x;
        // The diagonal alternates, so that the surface has no grain.
        if ((x + y) % 2) index.push(i, i + 1, i + n + 1, i + 1, i + n + 2, i + n + 1);
        else index.push(i, i + 1, i + n + 2, i, i + n + 2, i + n + 1);
      }
    }
    this.geometry.setIndex(index);
    this.geometry.setAttribute("position", new Float32BufferAttribute(positions, 3));
    this.attribute.setUsage(DynamicDrawUsage);
    this.geometry.setAttribute("patchData", this.attribute);
    this.geometry.instanceCount = 0;
    this.geometry.boundingSphere = new Sphere(new Vector3(), Infinity);
  }

  add(x: number, y: number, step: number, level: number): void {
    if (this.count === MAX_PATCHES) return;
    const at = 4 * this.count++;
    this.values[at] = x;
    this.values[at + 1] = y;
    this.values[at + 2] = step;
    this.values[at + 3] = level;
  }

  finish(): void {
    this.attribute.clearUpdateRanges();
    this.attribute.addUpdateRange(0, 4 * this.count);
    this.attribute.needsUpdate = true;
  }
}

/** Patches to draw, and patches that cast shadows. */
export class Patches {
  readonly drawn = new PatchList();
  readonly casting = new PatchList();
  private levels = 1;
  private step = 0.1;
  private range = 10;
  private readonly frustum = new Frustum();
  private readonly matrix = new Matrix4();
  private readonly box = new Box3();
  private readonly eye = new Vector3();
  private readonly focus = new Vector3();
  private focusRadius = 0;
  private origin = { x: 0, y: 0 };
  private bounds = { low: -5, high: 5 };

  configure(parameters: PatchParameters): void {
    this.step = parameters.step;
    this.range = Math.max(parameters.range, 6.6 * PATCH_QUADS * parameters.step);
    this.levels = 1;
    while (this.step * PATCH_QUADS * 2 ** this.levels < HALF_GROUND) this.levels++;
    this.origin = parameters.origin;
    this.bounds = parameters.bounds;
  }

  /** Range of level 0 [m]; that of level n is 2^n times as long. */
  get finestRange(): number {
    return this.range;
  }

  /**
   * Select the patches for a view.
   *
   * @param eye position from which the levels follow [m]; that of the camera, unless it is orthographic.
   * @param focus middle of the shadows [m].
   * @param focusRadius distance to which the ground casts shadows [m].
   */
  select(camera: Camera, eye: Vector3, focus: Vector3, focusRadius: number): void {
    this.eye.copy(eye);
    this.focus.copy(focus);
    this.focusRadius = focusRadius;
    this.frustum.setFromProjectionMatrix(this.matrix.multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse));
    this.drawn.count = this.casting.count = 0;
    const side = this.side(this.levels);
    const { x, y } = this.origin;
    this.visit(x - side, y - side, this.levels);
    this.visit(x, y - side, this.levels);
    this.visit(x - side, y, this.levels);
    this.visit(x, y, this.levels);
    this.drawn.finish();
    this.casting.finish();
  }

  /** Side of the patch of a level [m]. */
  private side(level: number): number {
    return this.step * PATCH_QUADS * 2 ** level;
  }

  /** Add the patch at a corner, or its four finer parts as far as they are within the finer level's range. */
  private visit(x: number, y: number, level: number): void {
    const side = this.side(level);
    if (level === 0 || this.distance(x, y, side) > this.range * 2 ** (level - 1)) {
      this.add(x, y, side, level);
      return;
    }
    const half = side / 2;
    this.visit(x, y, level - 1);
    this.visit(x + half, y, level - 1);
    this.visit(x, y + half, level - 1);
    this.visit(x + half, y + half, level - 1);
  }

  private distance(x: number, y: number, side: number): number {
    const dx = Math.max(x - this.eye.x, this.eye.x - x - side, 0);
    const dy = Math.max(y - this.eye.y, this.eye.y - y - side, 0);
    return Math.hypot(dx, dy, this.eye.z - this.focus.z);
  }

  private add(x: number, y: number, side: number, level: number): void {
    const margin = level > 5 ? 60 : 0; // hills outside of the map
    this.box.min.set(x, y, this.bounds.low - margin);
    this.box.max.set(x + side, y + side, this.bounds.high + margin);
    const step = side / PATCH_QUADS;
    if (this.frustum.intersectsBox(this.box)) this.drawn.add(x, y, step, level);
    const { focus, focusRadius } = this;
    const near = x < focus.x + focusRadius && x + side > focus.x - focusRadius;
    if (near && y < focus.y + focusRadius && y + side > focus.y - focusRadius) this.casting.add(x, y, step, level);
  }
}

/**
 * GLSL of the vertex position of a patch. A vertex that the next coarser level lacks moves onto the middle of that
 * level's edge.
 */
export const PATCH_GLSL = /* glsl */ `
attribute vec4 patchData;
uniform vec4 lodEye;   // position, range of level 0 [m]
uniform float lodGround; // elevation from which distances are measured [m]

vec2 patchPosition() {
  vec2 index = position.xy;
  vec2 xy = patchData.xy + index * patchData.z;
  float range = lodEye.w * exp2(patchData.w);
  float distance = length(vec3(xy - lodEye.xy, lodEye.z - lodGround));
  float morph = smoothstep(0.72, 0.96, distance / range);
  return xy - fract(index * 0.5) * 2.0 * patchData.z * morph;
}
`;
