/** The camera of the page: one of several views, with a smooth transition between them. */

import { PerspectiveCamera, Quaternion, Vector3 } from "three";
import type { CameraName } from "../ui/interfaces";
import { bucketView, cabView } from "./mounted_view";
import { OrbitView } from "./orbit_view";
import { listenToPointers } from "./pointer_input";
import { TopView } from "./top_view";
import type { CameraPose, CameraView, ViewContext } from "./view";

/** Duration of a transition [s]. */
const TRANSITION = 0.7;

const FAR = 2500;

export const CAMERA_NAMES: readonly CameraName[] = ["orbit", "cab", "top", "bucket"];

export class CameraRig {
  readonly camera = new PerspectiveCamera(42, 1, 0.1, FAR);
  /** Point that is looked at. */
  readonly focus = new Vector3();
  private readonly views: Record<CameraName, CameraView> = {
    orbit: new OrbitView(),
    cab: cabView(),
    top: new TopView(),
    bucket: bucketView(),
  };
  private currentName: CameraName = "orbit";
  private other: CameraView | null = null;
  private readonly pose = newPose();
  private readonly start = newPose();
  private progress = 1;
  private readonly eye = new Vector3();

  constructor(canvas: HTMLCanvasElement) {
    listenToPointers(canvas, {
      drag: (dx, dy) => this.view.drag(dx, dy),
      pan: (dx, dy) => this.view.pan(dx, dy),
      zoom: (factor) => this.view.zoom(factor),
    });
  }

  get current(): CameraName {
    return this.currentName;
  }

  private get view(): CameraView {
    return this.other ?? this.views[this.currentName];
  }

  /** Use a view that is none of the named ones, at once. */
  use(view: CameraView): void {
    this.other = view;
    this.progress = 1;
  }

  /** Change to a view; `isSmooth` moves the camera there. */
  select(name: CameraName, isSmooth = true): void {
    if (name === this.currentName) return;
    this.currentName = name;
    copyPose(this.pose, this.start);
    this.start.fov = this.camera.fov;
    this.start.position.copy(this.camera.position);
    this.start.rotation.copy(this.camera.quaternion);
    this.progress = isSmooth ? 0 : 1;
  }

  update(context: ViewContext): void {
    const { camera, pose, start } = this;
    this.view.update(context, pose);
    this.progress = Math.min(this.progress + context.dt / TRANSITION, 1);
    const t = this.progress;
    const share = t * t * (3 - 2 * t);
    camera.position.lerpVectors(start.position, pose.position, share);
    camera.quaternion.slerpQuaternions(start.rotation, pose.rotation, share);
    camera.fov = start.fov + share * (pose.fov - start.fov);
    camera.near = Math.min(t < 1 ? start.near : pose.near, pose.near);
    camera.setViewOffset(context.aspect, 1, 0, context.lift, context.aspect, 1); // it sets the aspect, too
    this.focus.lerpVectors(start.focus, pose.focus, share);
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
  }

  /** Position from which the levels of detail follow: closer than the camera if its lens magnifies. */
  get detailEye(): Vector3 {
    const magnification = Math.tan((REFERENCE_FIELD * Math.PI) / 360) / Math.tan((this.camera.fov * Math.PI) / 360);
    return this.eye.copy(this.camera.position).sub(this.focus).divideScalar(Math.max(magnification, 1)).add(this.focus);
  }
}

/** Field of view for which the levels of detail are made [deg]. */
const REFERENCE_FIELD = 42;

function newPose(): CameraPose {
  return { position: new Vector3(), rotation: new Quaternion(), fov: 42, near: 0.1, focus: new Vector3() };
}

function copyPose(from: CameraPose, to: CameraPose): void {
  to.position.copy(from.position);
  to.rotation.copy(from.rotation);
  to.focus.copy(from.focus);
  to.fov = from.fov;
  to.near = from.near;
}
