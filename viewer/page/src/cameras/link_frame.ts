/** Cameras on links: x of the link points forward, z up. */

import { Matrix4, Quaternion, Vector3 } from "three";

/** From the axes of a camera in three.js (looks along -z, y up) to those of a link. */
const CAMERA_IN_LINK = new Quaternion().setFromRotationMatrix(
  new Matrix4().makeBasis(new Vector3(0, -1, 0), new Vector3(0, 0, 1), new Vector3(-1, 0, 0)),
);

/** Turn the rotation of a frame with x forward into that of a camera which looks that way. */
export function lookForward(rotation: Quaternion): void {
  rotation.multiply(CAMERA_IN_LINK);
}
