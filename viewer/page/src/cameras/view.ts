/** What a camera view is given and what it computes. */

import type { Quaternion, Vector3 } from "three";
import type { MachineView } from "../machines/machine_view";
import type { TerrainState } from "../world_state";

/** A pose of the camera and its lens. */
export interface CameraPose {
  position: Vector3;
  rotation: Quaternion;
  /** Vertical field of view [deg]. */
  fov: number;
  /** Distance of the near plane [m]. */
  near: number;
  /** Point that is looked at; shadows and levels of detail are arranged around it. */
  focus: Vector3;
}

export interface ViewContext {
  machine: MachineView | null;
  terrain: TerrainState | null;
  /** Ratio of width to height of the canvas. */
  aspect: number;
  /** Distance by which the center of the view is above that of the canvas, as a fraction of its height. */
  lift: number;
  /** Time since the last frame [s]. */
  dt: number;
}

/** One kind of view. Pointer movements are fractions of the height of the canvas. */
export interface CameraView {
  /** Write the pose. */
  update(context: ViewContext, pose: CameraPose): void;
  /** Turn or move by the primary button or one finger. */
  drag(dx: number, dy: number): void;
  /** Move by the secondary button or two fingers. */
  pan(dx: number, dy: number): void;
  /** Come closer by a factor below 1, or go away. */
  zoom(factor: number): void;
}
