/** The 3-D view, as the user interface uses it. */

import { CAMERA_NAMES } from "./cameras/camera_rig";
import type { Stage } from "./stage";
import { COLORINGS } from "./terrain/colorings";
import type { ViewPort } from "./ui/interfaces";

export function createViewPort(stage: Stage): ViewPort {
  const { cameras, quality, terrain, effects } = stage;
  return {
    cameras: CAMERA_NAMES,
    camera: () => cameras.current,
    setCamera: (name) => cameras.select(name),
    colorings: COLORINGS,
    coloring: () => terrain.coloring,
    setColoring: (id) => {
      terrain.coloring = id;
    },
    legend: () => terrain.legend(),
    hasEffect: (name) => effects[name],
    setEffect: (name, on) => {
      effects[name] = on;
    },
    quality: () => quality.level,
    selectedQuality: () => quality.selected,
    setQuality: (name) => quality.select(name),
    selectMachine: (id) => {
      stage.followed = id;
    },
    setCovered: (top, bottom) => {
      stage.covered = { top, bottom };
    },
    framesPerSecond: () => quality.framesPerSecond,
    distanceTo: (machine) => {
      const view = stage.machines.views.get(machine);
      return view ? view.basePosition.distanceTo(cameras.camera.position) : Infinity;
    },
  };
}
