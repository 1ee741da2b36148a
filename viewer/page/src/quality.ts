/** Levels of quality and the resolution, selected by the user or by the measured frame time. */

import type { QualityName } from "./ui/interfaces";
import type { TerrainDetail } from "./terrain/terrain";

export interface QualityLevel {
  /** Largest ratio of drawn pixels to CSS pixels. */
  pixelRatio: number;
  /** Texels along each side of the shadow map; 0 for no shadows. */
  shadowSize: number;
  /** Whether surfaces reflect a picture of the sky. */
  hasSkyLight: boolean;
  /** Subdivisions of the faces of particles, which are icosahedra. */
  lumpDetail: 0 | 1;
  terrain: TerrainDetail;
}

const LEVELS: Record<QualityName, QualityLevel> = {
  low: {
    pixelRatio: 1,
    shadowSize: 0,
    hasSkyLight: false,
    lumpDetail: 0,
    terrain: { subdivision: 1, range: 0, tuftReach: 0, isPlain: true },
  },
  medium: {
    pixelRatio: 1.5,
    shadowSize: 2048,
    hasSkyLight: true,
    lumpDetail: 1,
    terrain: { subdivision: 2, range: 10, tuftReach: 14, isPlain: false },
  },
  high: {
    pixelRatio: 2,
    shadowSize: 4096,
    hasSkyLight: true,
    lumpDetail: 1,
    terrain: { subdivision: 2, range: 18, tuftReach: 30, isPlain: false },
  },
};

const ORDER: readonly QualityName[] = ["low", "medium", "high"];

/** Frame times at which the automatic selection changes the level [s]. */
const SLOW = 1 / 28;
const FAST = 1 / 55;

/** Duration of an interval that is judged [s]. */
const INTERVAL = 2;

/** Frame time above which the lowest level is drawn with fewer pixels [s], by which share, and the smallest share. */
const TOO_SLOW = 1 / 12;
const RESOLUTION_STEP = Math.SQRT1_2;
const MIN_RESOLUTION = 0.5;

export class Quality {
  level: QualityName;
  /** Share of the level's pixels that are drawn along each side. */
  resolution = 1;
  /** Frames drawn per second, averaged over about a second. */
  framesPerSecond = 0;
  private isAutomatic: boolean;
  private isInterrupted = false;
  private elapsed = 0;
  private frames = 0;
  private average = 0;
  private ceiling = ORDER.length - 1;
  private goodIntervals = 0;
  private readonly handlers: ((level: QualityLevel) => void)[] = [];

  /**
   * @param selected level of the user; null selects automatically.
   * @param initial first level of the automatic selection.
   */
  constructor(selected: QualityName | null, initial: QualityName) {
    this.isAutomatic = selected === null;
    this.level = selected ?? initial;
  }

  get values(): QualityLevel {
    return LEVELS[this.level];
  }

  get selected(): QualityName | "automatic" {
    return this.isAutomatic ? "automatic" : this.level;
  }

  select(name: QualityName | "automatic"): void {
    this.isAutomatic = name === "automatic";
    this.ceiling = ORDER.length - 1;
    this.set(name === "automatic" ? this.level : name, 1);
  }

  /** Do not count the time until the next frame, for example while the page is hidden. */
  interrupt(): void {
    this.isInterrupted = true;
  }

  /** Call `handler` now and at each change of the level. */
  onChange(handler: (level: QualityLevel) => void): void {
    this.handlers.push(handler);
    handler(this.values);
  }

  /** Count a drawn frame, `dt` [s] after the last one. */
  count(dt: number): void {
    if (this.isInterrupted) {
      this.isInterrupted = false;
      return;
    }
    this.average += (dt - this.average) * Math.min(dt * 2, 1);
    this.framesPerSecond = this.average > 0 ? 1 / this.average : 0;
    this.elapsed += dt;
    this.frames++;
    if (this.elapsed < INTERVAL) return;
    const frameTime = this.elapsed / this.frames;
    this.elapsed = this.frames = 0;
    if (this.level === ORDER[0] && frameTime > TOO_SLOW) {
      this.set(this.level, Math.max(this.resolution * RESOLUTION_STEP, MIN_RESOLUTION));
    } else if (this.isAutomatic) this.adapt(frameTime);
  }

  private adapt(frameTime: number): void {
    const index = ORDER.indexOf(this.level);
    if (frameTime > SLOW && index > 0) {
      this.ceiling = index - 1; // a level that was too slow is not tried again
      this.goodIntervals = 0;
      this.set(ORDER[index - 1]!, 1);
    } else if (frameTime < FAST && index < this.ceiling && ++this.goodIntervals >= 3) {
      this.goodIntervals = 0;
      this.set(ORDER[index + 1]!, 1);
    }
  }

  private set(level: QualityName, resolution: number): void {
    if (level === this.level && resolution === this.resolution) return;
    this.level = level;
    this.resolution = resolution;
    for (const handler of this.handlers) handler(this.values);
  }
}
