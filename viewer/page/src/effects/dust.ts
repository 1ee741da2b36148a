/** Dust where falling particles hit the ground. */

import { PARTICLE_BYTES } from "../protocol";
import type { ParticleState, WorldState } from "../world_state";
import { Puff, type Puffs } from "./puffs";

/** Particles that fall faster than this [m/s], this close to the ground [m], raise dust. */
const MIN_SPEED = 1.3;
const MAX_CLEARANCE = 0.35;

/** Largest number of puffs for each message with particles. */
const MAX_PUFFS = 5;

/** Moisture above which soil does not raise dust [%]. */
const MAX_MOISTURE = 70;

export class Dust {
  private seenVersion = -1;
  private readonly puff = new Puff(0.06);

  constructor(private readonly puffs: Puffs) {}

  update(world: WorldState): void {
    const { particles } = world;
    if (!particles || particles.version === this.seenVersion) return;
    this.seenVersion = particles.version;
    if (particles.count > 0) this.emitFor(world, particles);
  }

  /** Look at the particles from a random one on, so that the puffs spread over the whole stream. */
  private emitFor(world: WorldState, particles: ParticleState): void {
    const { terrain } = world;
    if (!terrain) return;
    const { data, origin, scale, count } = particles;
    const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
    const first = Math.floor(Math.random() * count);
    let emitted = 0;
    for (let n = 0; n < count && emitted < MAX_PUFFS; n++) {
      const at = ((first + n) % count) * PARTICLE_BYTES;
      const vz = view.getInt16(at + 12, true) / 1000;
      if (vz > -MIN_SPEED) continue;
      const x = origin[0] + scale[0] * view.getUint16(at, true);
      const y = origin[1] + scale[1] * view.getUint16(at + 2, true);
      const z = origin[2] + scale[2] * view.getUint16(at + 4, true);
      const ground = terrain.heightAt(x, y);
      if (z - ground > MAX_CLEARANCE) continue;
      const wetness = terrain.moistureAt(x, y) / MAX_MOISTURE;
      if (Math.random() < wetness) continue;
      this.emit(world, view.getUint8(at + 15), x, y, ground, -vz);
      emitted++;
    }
  }

  private emit(world: WorldState, soil: number, x: number, y: number, ground: number, speed: number): void {
    const { puff } = this;
    const { size, color } = puff;
    const angle = 2 * Math.PI * Math.random();
    const outward = (0.25 + 0.22 * Math.random()) * Math.min(speed, 6);
    puff.position.set(x, y, ground + 0.12);
    puff.velocity.set(Math.cos(angle) * outward, Math.sin(angle) * outward, 0.12 * speed * Math.random());
    puff.life = 1.3 + 1.8 * Math.random();
    size[0] = 0.25 + 0.25 * Math.random();
    size[1] = 1.1 + 1.1 * Math.random();
    puff.opacity = 0.05 + 0.035 * Math.min(speed, 5) * Math.random();
    const [r, g, b] = world.site?.soils.find(({ id }) => id === soil)?.color ?? [0.5, 0.42, 0.33];
    // Dry dust is paler than the soil.
    color[0] = 0.35 + 0.5 * r * r;
    color[1] = 0.31 + 0.5 * g * g;
    color[2] = 0.25 + 0.5 * b * b;
    this.puffs.emit(puff);
  }
}
