/** What tests and the console read of the page, as `window.viewer`. */

import type { Connection } from "./connection";
import type { Stage } from "./stage";
import type { WorldState } from "./world_state";

export interface TestInterface {
  state(): Record<string, unknown>;
  /** Return heights [m], read back from the texture that is drawn, row by row. */
  heights(row0: number, col0: number, rows: number, cols: number): number[];
  /** Lose the graphics context, and get it back. */
  loseContext(): void;
  readonly stage: Stage;
}

declare global {
  interface Window {
    viewer: TestInterface;
  }
}

export function installTestInterface(connection: Connection, world: WorldState, stage: Stage): void {
  window.viewer = {
    stage,
    state: () => ({
      connection: connection.status,
      ready: world.terrain?.isComplete ?? false,
      run: world.site?.run_id ?? null,
      tick: world.frame?.tick ?? null,
      time: world.frame?.time ?? null,
      fps: stage.quality.framesPerSecond,
      frames: stage.frames,
      quality: stage.quality.level,
      camera: stage.cameras.current,
      coloring: stage.terrain.coloring,
      drivers: world.drivers,
      particles: world.particles?.count ?? 0,
      bytes: connection.bytesReceived,
      triangles: stage.renderer.info.render.triangles,
      machines: machineStates(stage),
    }),
    heights: (row0, col0, rows, cols) => stage.terrain.readHeights(stage.renderer, row0, col0, rows, cols),
    loseContext: () => {
      const extension = stage.renderer.getContext().getExtension("WEBGL_lose_context");
      extension?.loseContext();
      setTimeout(() => extension?.restoreContext(), 200);
    },
  };
}

/** Return the pose of each link as 4 x 4 matrices, column by column, map frame. */
function machineStates(stage: Stage): Record<string, unknown> {
  const machines: Record<string, unknown> = {};
  for (const [id, view] of stage.machines.views) {
    const links: Record<string, number[]> = {};
    for (const [name, link] of view.links) links[name] = link.matrixWorld.toArray();
    machines[id] = { time: view.state.time, links };
  }
  return machines;
}
