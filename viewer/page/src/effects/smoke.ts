/** Exhaust smoke from the links `exhaust`: more and darker under load. */

import { clamp } from "../clamp";
import type { MachineView } from "../machines/machine_view";
import { Puff, type Puffs } from "./puffs";

/** Puffs in each second at idle, and more at full load. */
const IDLE_RATE = 9;
const LOAD_RATE = 24;

/** A rise of the load blackens the smoke for this time [s]. */
const SURGE_TIME = 0.8;

interface Engine {
  due: number;
  load: number;
  surge: number;
}

export class Smoke {
  private readonly engines = new Map<string, Engine>();
  private readonly puff = new Puff(0.25);

  constructor(private readonly puffs: Puffs) {}

  /** @param dt simulated time since the last call [s]. */
  update(views: Iterable<MachineView>, dt: number): void {
    for (const view of views) {
      const exhaust = view.findLink("exhaust");
      if (!exhaust || view.state.frames === 0) continue;
      let engine = this.engines.get(view.id);
      if (!engine) this.engines.set(view.id, (engine = { due: 0, load: 0, surge: 0 }));
      const load = clamp(view.state.load, 0, 1);
      engine.surge = Math.max(engine.surge * Math.exp(-dt / SURGE_TIME), Math.min(3 * (load - engine.load), 1));
      engine.load += (load - engine.load) * Math.min(dt / 0.3, 1);
      engine.due += dt * (IDLE_RATE + LOAD_RATE * engine.load);
      this.puff.position.setFromMatrixPosition(exhaust.matrixWorld);
      while (engine.due >= 1) {
        engine.due--;
        this.emit(engine);
      }
    }
  }

  private emit({ load, surge }: Engine): void {
    const { puff } = this;
    const { size, color } = puff;
    const speed = 1.1 + 2.2 * load;
    // A narrow cone around the vertical, bent back by a random amount.
    puff.velocity.set((Math.random() - 0.5) * 0.5 * speed, (Math.random() - 0.5) * 0.5 * speed, speed * (0.8 + 0.4 * Math.random()));
    puff.life = 1.1 + 1.3 * Math.random() + 0.5 * load;
    size[0] = 0.1 + 0.05 * Math.random();
    size[1] = 0.7 + 0.8 * Math.random() + 0.5 * load;
    puff.opacity = Math.min(0.1 + 0.22 * load + 0.3 * surge, 0.6);
    const grey = Math.max(0.3 - 0.17 * load - 0.12 * surge, 0.03) * (0.85 + 0.3 * Math.random());
    color[0] = grey;
    color[1] = grey;
    color[2] = grey * 1.04;
    this.puffs.emit(puff);
  }
}
