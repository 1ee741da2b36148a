/** A camera mounted on a link: the operator's view, or that of a camera at the arm. It can look around. */

import { Euler, Quaternion, Vector3 } from "three";
import { clamp } from "../clamp";
import { lookForward } from "./link_frame";
import type { CameraPose, CameraView, ViewContext } from "./view";

/** A place for the camera: position [m] and downward tilt [rad] in a link. */
interface Mount {
  link: string;
  position: readonly [number, number, number];
  tilt: number;
}

interface MountedViewOptions {
  /** The first one whose link the machine has is used. */
  mounts: readonly Mount[];
  /** Vertical field of view [deg]. */
  fov: number;
  near: number;
  /** Largest angles of looking around: to a side, up, down [rad]. */
  limits: readonly [number, number, number];
  /** Distance of what is looked at [m]. */
  reach: number;
  /** Additional downward tilt where panels cover the lower part of the canvas [rad], to see what is below the axis. */
  coveredTilt: number;
}

class MountedView implements CameraView {
  private yaw = 0;
  private pitch = 0;
  private fov: number;
  private readonly look = new Quaternion();
  private readonly euler = new Euler(0, 0, 0, "ZYX");
  private readonly scale = new Vector3();

  constructor(private readonly options: MountedViewOptions) {
    this.fov = options.fov;
  }

  update({ machine, terrain, aspect, lift }: ViewContext, pose: CameraPose): void {
    const mount = machine && this.options.mounts.find(({ link }) => machine.findLink(link));
    const link = mount && machine.findLink(mount.link);
    if (!mount || !link) return;
    link.matrixWorld.decompose(pose.position, pose.rotation, this.scale);
    pose.position.set(...mount.position).applyMatrix4(link.matrixWorld);
    const tilt = mount.tilt + (lift > 0 ? this.options.coveredTilt : 0);
    pose.rotation.multiply(this.look.setFromEuler(this.euler.set(0, tilt - this.pitch, this.yaw)));
    pose.focus.set(this.options.reach, 0, 0).applyQuaternion(pose.rotation).add(pose.position);
    lookForward(pose.rotation);
    if (terrain) {
      const ground = terrain.heightAt(pose.position.x, pose.position.y);
      pose.position.z = Math.max(pose.position.z, ground + 0.15);
      pose.focus.z = Math.max(pose.focus.z, terrain.heightAt(pose.focus.x, pose.focus.y));
    }
    pose.fov = aspect < 1 ? Math.min(this.fov * 1.25, 95) : this.fov;
    pose.near = this.options.near;
  }

  drag(dx: number, dy: number): void {
    const [side, up, down] = this.options.limits;
    this.yaw = clamp(this.yaw + 1.6 * dx, -side, side);
    this.pitch = clamp(this.pitch + 1.2 * dy, -down, up);
  }

  pan(dx: number, dy: number): void {
    this.drag(dx, dy);
  }

  zoom(factor: number): void {
    this.fov = clamp(this.fov * Math.sqrt(factor), 30, 95);
  }
}

/** The operator's eyes; without a link for them, where seats usually are. */
export function cabView(): MountedView {
  return new MountedView({
    mounts: [
      { link: "cab_camera", position: [0, 0, 0], tilt: 0 },
      { link: "upper", position: [0.85, 0.87, 1.6], tilt: 0.2 },
      { link: "base_link", position: [2.2, 0, 2.6], tilt: 0.25 },
    ],
    fov: 72,
    near: 0.04,
    limits: [2.4, 0.9, 1.1],
    reach: 7,
    coveredTilt: 0,
  });
}

/** A camera that sees the tool at work; without a link for it, one at the side of the arm. */
export function bucketView(): MountedView {
  return new MountedView({
    mounts: [
      { link: "bucket_camera", position: [0, 0, 0], tilt: 0 },
      { link: "boom", position: [4.3, -0.5, 0.1], tilt: 1.0 },
      { link: "base_link", position: [3.5, -2.5, 2.2], tilt: 0.4 },
    ],
    fov: 58,
    near: 0.06,
    limits: [1.2, 0.9, 0.9],
    reach: 3,
    coveredTilt: 0.3,
  });
}
