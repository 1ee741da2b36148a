/** Rotation of a camera that looks at a point. */

import { Matrix4, type Quaternion, Vector3 } from "three";

const matrix = new Matrix4();
const zAxis = new Vector3(0, 0, 1);

export function lookAt(rotation: Quaternion, position: Vector3, target: Vector3, up: Vector3 = zAxis): void {
  rotation.setFromRotationMatrix(matrix.lookAt(position, target, up));
}
