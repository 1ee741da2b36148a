/** How long nothing has arrived from the server. */

/**
 * Longest time that one call of `advance` counts [ms]. While the page itself works, as when it draws without a graphics card,
 * messages wait in the browser: that time is no silence of the server.
 */
const MAX_STEP_MS = 250;

/** Time after which the picture counts as old [ms]; the server sends a frame every 500 ms although nothing has changed. */
export const SILENCE_MS = 1500;

/** Time after which the connection counts as lost [ms]; the server gives up one that does not answer after 30 s, too. */
const LOSS_MS = 30_000;

/** Counts the time without a message; the caller has a timer. A stalled connection stays open: nothing else shows it. */
export class Silence {
  private silent = 0;
  private last: number | null = null;

  /** Whether the state that the page shows is old. */
  get isLong(): boolean {
    return this.silent >= SILENCE_MS;
  }

  /** Whether the connection must be opened again. */
  get isLoss(): boolean {
    return this.silent >= LOSS_MS;
  }

  /** Receive that a message has arrived. */
  end(): void {
    this.silent = 0;
  }

  /** Receive the time [ms], at an interval of about 100 ms. */
  advance(now: number): void {
    if (this.last !== null) this.silent += Math.min(now - this.last, MAX_STEP_MS);
    this.last = now;
  }
}
