/** All machines of the scene. */

import { Group } from "three";
import { clamp } from "../clamp";
import type { WorldState } from "../world_state";
import { MachineView } from "./machine_view";

export class Machines {
  readonly group = new Group();
  readonly views = new Map<string, MachineView>();

  constructor(private readonly world: WorldState) {}

  /** Make and remove machines as the messages did, and move all of them. */
  update(now: number, dt: number): void {
    const { machines, frame } = this.world;
    for (const [id, view] of this.views) {
      if (machines.get(id) === view.state) continue;
      view.dispose();
      this.views.delete(id);
    }
    for (const [id, state] of machines) {
      if (this.views.has(id)) continue;
      const view = new MachineView(state);
      this.views.set(id, view);
      this.group.add(view.root);
    }
    const rate = frame && !frame.paused ? clamp(frame.rtf, 0, 2) : 0;
    for (const view of this.views.values()) view.update(now, dt, rate);
  }
}
