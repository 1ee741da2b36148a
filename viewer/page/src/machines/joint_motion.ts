/** Motion of a value between frames: extrapolation by its velocity, and no jump when the next frame arrives. */

import { clamp } from "../clamp";

/** Longest extrapolation [s]. */
const MAX_EXTRAPOLATION = 0.1;

/** Time in which a difference between the extrapolation and the next frame decays to 1/e [s]. */
const DECAY_TIME = 0.06;

/** A larger difference is a jump (reset, seek) and is shown at once [rad or m]. */
const JUMP = 0.8;

/** Values of several joints, or coordinates. */
export class SmoothValues {
  /** Values to show. */
  readonly shown: Float64Array;
  private readonly latest: Float64Array;
  private readonly velocities: Float64Array;
  private readonly differences: Float64Array;
  private hasValues = false;

  constructor(readonly count: number) {
    this.shown = new Float64Array(count);
    this.latest = new Float64Array(count);
    this.velocities = new Float64Array(count);
    this.differences = new Float64Array(count);
  }

  /** Receive the values and velocities of a frame. */
  receive(values: ArrayLike<number>, velocities: ArrayLike<number>): void {
    for (let i = 0; i < this.count; i++) {
      const value = values[i]!;
      const difference = this.shown[i]! - value;
      this.differences[i] = this.hasValues && Math.abs(difference) < JUMP ? difference : 0;
      this.latest[i] = value;
      this.velocities[i] = velocities[i]!;
    }
    this.hasValues = true;
  }

  /**
   * Compute the values to show.
   *
   * @param age simulated time since the frame [s].
   * @param dt time since the last call [s].
   */
  update(age: number, dt: number): void {
    const ahead = clamp(age, 0, MAX_EXTRAPOLATION);
    const decay = Math.exp(-dt / DECAY_TIME);
    for (let i = 0; i < this.count; i++) {
      const difference = this.differences[i]! * decay;
      this.differences[i] = difference;
      this.shown[i] = this.latest[i]! + this.velocities[i]! * ahead + difference;
    }
  }
}
