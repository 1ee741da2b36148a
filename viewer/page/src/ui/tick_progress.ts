/** Whether simulated time moves. */

/** Wall time without a tick after which the simulation counts as standing still [ms]. */
const STANDSTILL_MS = 2000;

/** Watches the tick of the frames: the last ratio to real time and state stay in them when the soil node has ended. */
export class TickProgress {
  private tick: number | null = null;
  private since = 0;

  /** Receive the newest tick and the time [ms]; return whether there was no tick for some time. */
  update(tick: number | null, now: number): boolean {
    if (tick === null || tick !== this.tick) {
      this.tick = tick;
      this.since = now;
    }
    return now - this.since > STANDSTILL_MS;
  }
}
