/**
 * What the user interface and the 3-D view need of each other. `main.ts` makes the connection, the state of the world and
 * the view, and passes them to `createUserInterface`, which subscribes to the connection itself.
 */

import type { Connection } from "../connection";
import type { Rgb } from "../protocol";
import type { WorldState } from "../world_state";

export type CameraName = "orbit" | "cab" | "top" | "bucket";

export type QualityName = "low" | "medium" | "high";

/** Effects of the view; the sound belongs to the user interface. */
export type EffectName = "smoke" | "dust";

/** One way to colour the terrain. */
export interface Coloring {
  id: string;
  label: string;
}

/** Explanation of the present colours. */
export type Legend =
  | {
      kind: "gradient";
      title: string;
      unit: string;
      /** Ascending values with their colours, sRGB 0 to 1. */
      stops: readonly { value: number; color: Rgb }[];
    }
  | { kind: "swatches"; title: string; items: readonly { label: string; color: Rgb }[] };

/** The 3-D view, as the user interface uses it. */
export interface ViewPort {
  readonly cameras: readonly CameraName[];
  camera(): CameraName;
  setCamera(name: CameraName): void;
  readonly colorings: readonly Coloring[];
  coloring(): string;
  setColoring(id: string): void;
  /** Legend of the present colouring; null if it needs none. It is read about twice a second. */
  legend(): Legend | null;
  hasEffect(name: EffectName): boolean;
  setEffect(name: EffectName, on: boolean): void;
  /** Level in use. */
  quality(): QualityName;
  /** What the user selected. */
  selectedQuality(): QualityName | "automatic";
  setQuality(name: QualityName | "automatic"): void;
  /** Machine that cameras follow. */
  selectMachine(id: string): void;
  /** Center the scene between panels that cover the canvas at its top and its bottom edge; heights [px]. */
  setCovered(top: number, bottom: number): void;
  /** Frames drawn per second, averaged over about a second. */
  framesPerSecond(): number;
  /** Distance from the camera to a machine [m], for the volume of its engine. */
  distanceTo(machine: string): number;
}

/** What `createUserInterface` is given. */
export interface App {
  readonly connection: Connection;
  /** State that is subscribed to the connection before the user interface. */
  readonly world: WorldState;
  readonly view: ViewPort;
  /** Element in which the user interface is made, `#ui`. */
  readonly root: HTMLElement;
}
