/** Views of pictures: a view of a machine at given angles, or a fixed pose. */

import { MathUtils, Vector3 } from "three";
import type { PictureCamera } from "../protocol";
import { lookAt } from "./look_at";
import { bucketView, cabView } from "./mounted_view";
import { OrbitView } from "./orbit_view";
import { TopView } from "./top_view";
import type { CameraPose, CameraView, ViewContext } from "./view";

/** A view that no pointer moves. */
class PictureView implements CameraView {
  constructor(
    private readonly place: (context: ViewContext, pose: CameraPose) => void,
    private readonly fov: number | undefined,
  ) {}

  update(context: ViewContext, pose: CameraPose): void {
    this.place(context, pose);
    if (this.fov !== undefined) pose.fov = this.fov;
  }

  drag(): void {}

  pan(): void {}

  zoom(): void {}
}

/** Return the view of a picture. */
export function pictureView(camera: PictureCamera): CameraView {
  if ("position" in camera) {
    const position = new Vector3(...camera.position);
    const target = new Vector3(...camera.target);
    const up = new Vector3(...camera.up);
    return new PictureView((_, pose) => {
      pose.position.copy(position);
      pose.focus.copy(target);
      lookAt(pose.rotation, position, target, up);
      pose.near = 0.05;
    }, camera.fov);
  }
  const view = machineView(camera);
  return new PictureView((context, pose) => view.update(context, pose), camera.fov);
}

function machineView(camera: Extract<PictureCamera, { view: string }>): CameraView {
  const { azimuth, elevation, distance } = camera;
  switch (camera.view) {
    case "cab":
      return cabView();
    case "bucket":
      return bucketView();
    case "top":
      return new TopView(distance);
    case "orbit":
      return new OrbitView({
        ...(azimuth !== undefined && { azimuth: MathUtils.degToRad(azimuth) }),
        ...(elevation !== undefined && { elevation: MathUtils.degToRad(elevation) }),
        ...(distance !== undefined && { distance }),
      });
  }
}
