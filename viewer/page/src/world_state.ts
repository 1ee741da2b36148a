/** The latest state of the world, decoded from the messages. The 3-D view and the user interface read it. */

import { clamp } from "./clamp";
import type { Connection } from "./connection";
import {
  PARTICLE_BYTES,
  TILE,
  TILE_BYTES,
  type FrameMessage,
  type Gauges,
  type HelloMessage,
  type MachineFrame,
  type MachineMessage,
  type ParticleBlock,
  type SiteMessage,
  type TileBlock,
} from "./protocol";
import { hasSameContent } from "./same_content";

const TILE_CELLS = TILE * TILE;

/** Layers of the terrain in grid_map order: index = row * cols + col, (0, 0) is the corner at +x, +y. */
export class TerrainState {
  readonly rows: number;
  readonly cols: number;
  /** Side of a cell [m]. */
  readonly cell: number;
  readonly tileRows: number;
  readonly tileCols: number;
  /** Elevation [m]. */
  readonly height: Float32Array;
  /** Soil, moisture [%], and loose depth [mm] (low byte, high byte) of each cell. */
  readonly cells: Uint8Array;
  /** Elevation of the first keyframe of the run [m]. */
  readonly reference: Float32Array;
  /** Design elevation [m], NaN where there is none. */
  readonly design: Float32Array | null;
  /** 1 for each tile that has changed since a view cleared it. */
  readonly dirty: Uint8Array;
  /** Number of tiles that have been received at least once. */
  tilesReceived = 0;
  /** Counts changes. */
  version = 0;
  private readonly received: Uint8Array;

  constructor(site: SiteMessage) {
    this.rows = site.rows;
    this.cols = site.cols;
    this.cell = site.cell;
    this.tileRows = Math.ceil(site.rows / TILE);
    this.tileCols = Math.ceil(site.cols / TILE);
    this.reference = floats(site.reference);
    this.design = site.design ? floats(site.design) : null;
    this.height = this.reference.slice();
    this.cells = new Uint8Array(4 * site.rows * site.cols);
    this.dirty = new Uint8Array(this.tileRows * this.tileCols).fill(1);
    this.received = new Uint8Array(this.tileRows * this.tileCols);
  }

  /** Whether each tile has been received. */
  get isComplete(): boolean {
    return this.tilesReceived === this.received.length;
  }

  /** Return the elevation at a position [m], bilinear; positions outside get that of the border. */
  heightAt(x: number, y: number): number {
    const { rows, cols, height } = this;
    const row = this.rowAt(x);
    const col = this.colAt(y);
    const r = Math.min(Math.floor(row), rows - 2);
    const c = Math.min(Math.floor(col), cols - 2);
    const i = r * cols + c;
    const near = height[i]! + (col - c) * (height[i + 1]! - height[i]!);
    const far = height[i + cols]! + (col - c) * (height[i + cols + 1]! - height[i + cols]!);
    return near + (row - r) * (far - near);
  }

  /** Return the moisture of the cell at a position [%]; positions outside get that of the border. */
  moistureAt(x: number, y: number): number {
    const index = Math.round(this.rowAt(x)) * this.cols + Math.round(this.colAt(y));
    return this.cells[4 * index + 1]!;
  }

  /** Return the row of a position, with a fraction between the centres of cells. */
  private rowAt(x: number): number {
    return clamp((this.rows - 1) / 2 - x / this.cell, 0, this.rows - 1);
  }

  /** Return its column, likewise. */
  private colAt(y: number): number {
    return clamp((this.cols - 1) / 2 - y / this.cell, 0, this.cols - 1);
  }

  applyTiles(block: TileBlock): void {
    const { rows, cols, tileCols, height, cells } = this;
    const index = new DataView(block.index.buffer, block.index.byteOffset, block.index.byteLength);
    const data = new DataView(block.data.buffer, block.data.byteOffset, block.data.byteLength);
    for (let n = 0; n < block.count; n++) {
      const tile = index.getUint32(4 * n, true);
      const row0 = Math.floor(tile / tileCols) * TILE;
      const col0 = (tile % tileCols) * TILE;
      const start = n * TILE_BYTES;
      const numRows = Math.min(TILE, rows - row0);
      const numCols = Math.min(TILE, cols - col0);
      for (let r = 0; r < numRows; r++) {
        for (let c = 0; c < numCols; c++) {
          const from = r * TILE + c;
          const to = (row0 + r) * cols + col0 + c;
          height[to] = data.getFloat32(start + 4 * from, true);
          const loose = start + 4 * TILE_CELLS + 2 * from;
          cells[4 * to] = data.getUint8(start + 6 * TILE_CELLS + from);
          cells[4 * to + 1] = data.getUint8(start + 7 * TILE_CELLS + from);
          cells[4 * to + 2] = data.getUint8(loose);
          cells[4 * to + 3] = data.getUint8(loose + 1);
        }
      }
      this.dirty[tile] = 1;
      if (!this.received[tile]) {
        this.received[tile] = 1;
        this.tilesReceived++;
      }
    }
    if (block.count > 0) this.version++;
  }
}

/** The latest state of one machine. It belongs to one model: another model makes another state. */
export class MachineState {
  /** Simulation time of the state [s]. */
  time = 0;
  /** When the state was received [ms], as `performance.now()`. */
  receivedAt = 0;
  /** Joint values in the order of `model.joints` [rad or m]. */
  readonly positions: Float32Array;
  /** Joint velocities [rad/s or m/s]. */
  readonly velocities: Float32Array;
  base: MachineFrame["base"] = null;
  /** Engine load, 0 to 1. */
  load = 0;
  gauges: Gauges = {};
  /** Number of frames that have set the state. */
  frames = 0;

  /** @param message description of the machine; levers and pattern may be replaced later. */
  constructor(public message: MachineMessage) {
    this.positions = new Float32Array(message.model.joints.length);
    this.velocities = new Float32Array(message.model.joints.length);
  }

  get id(): string {
    return this.message.id;
  }

  apply(frame: MachineFrame, now: number): void {
    this.time = frame.time;
    this.receivedAt = now;
    copyFloats(frame.positions, this.positions);
    copyFloats(frame.velocities, this.velocities);
    this.base = frame.base;
    this.load = frame.load;
    this.gauges = frame.gauges;
    this.frames++;
  }
}

/** The particles of the latest frame that had some. */
export interface ParticleState extends ParticleBlock {
  /** When they were received [ms], as `performance.now()`. */
  receivedAt: number;
  /** Counts changes. */
  version: number;
}

export class WorldState {
  hello: HelloMessage | null = null;
  site: SiteMessage | null = null;
  terrain: TerrainState | null = null;
  readonly machines = new Map<string, MachineState>();
  particles: ParticleState | null = null;
  /** The latest frame. */
  frame: FrameMessage | null = null;
  /** Driver of each machine that has one. */
  drivers: Record<string, { id: string; is_you: boolean }> = {};

  /** Subscribe before all others, so that their handlers find the state of the message. */
  constructor(connection: Connection) {
    connection.on("hello", (message) => {
      this.clear();
      this.hello = message;
    });
    connection.on("site", (message) => {
      this.site = message;
      this.terrain = new TerrainState(message);
      this.particles = null;
    });
    connection.on("machine", (message) => {
      this.describe(message);
    });
    connection.on("machine_gone", (message) => {
      this.machines.delete(message.id);
    });
    connection.on("control", (message) => {
      this.drivers = message.drivers;
    });
    connection.on("frame", (message) => this.applyFrame(message));
  }

  /** Set the description of a machine. Its state, and with it what is drawn, remains unless the model differs. */
  private describe(message: MachineMessage): void {
    const known = this.machines.get(message.id);
    if (known === undefined || !hasSameContent(known.message.model, message.model)) {
      this.machines.set(message.id, new MachineState(message));
    } else if (!hasSameContent(known.message, message)) {
      known.message = { ...message, model: known.message.model };
    }
  }

  private applyFrame(message: FrameMessage): void {
    const now = performance.now();
    this.frame = message;
    if (this.site?.run_id === message.run_id) this.terrain?.applyTiles(message.tiles);
    if (message.particles && message.particles.data.byteLength >= message.particles.count * PARTICLE_BYTES) {
      this.particles = { ...message.particles, receivedAt: now, version: (this.particles?.version ?? 0) + 1 };
    }
    for (const machine of message.machines) this.machines.get(machine.id)?.apply(machine, now);
  }

  private clear(): void {
    this.site = null;
    this.terrain = null;
    this.machines.clear();
    this.particles = null;
    this.frame = null;
    this.drivers = {};
  }
}

/** Return a copy of little-endian floats, whose bytes may be unaligned. */
function floats(bytes: Uint8Array): Float32Array {
  return new Float32Array(bytes.slice().buffer);
}

function copyFloats(bytes: Uint8Array, target: Float32Array): void {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const count = Math.min(target.length, bytes.byteLength >> 2);
  for (let i = 0; i < count; i++) target[i] = view.getFloat32(4 * i, true);
}
