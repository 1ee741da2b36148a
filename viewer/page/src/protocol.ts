/**
 * Messages between the page and the server (`viewer/server`). Server messages are msgpack maps, page messages are
 * JSON. Units are SI unless a name says otherwise; positions are in the map frame, z up.
 */

/** Version of the protocol; the server refuses another one. */
export const PROTOCOL = 1;

/** Side of a terrain tile [cells]. */
export const TILE = 16;

/** Bytes of a tile: heights f32, loose depths u16 [mm], soil u8, moisture u8 [%], of TILE * TILE cells each. */
export const TILE_BYTES = TILE * TILE * 8;

/** Bytes of a particle: u16 x, y, z, id; i16 vx, vy, vz [mm/s]; u8 diameter [5 mm]; u8 soil. */
export const PARTICLE_BYTES = 16;

/** Unit of a particle's diameter [m]. */
export const DIAMETER_UNIT = 0.005;

export type Vec3 = [number, number, number];
export type Rgb = [number, number, number];
export type Rgba = [number, number, number, number];

export interface Origin {
  xyz: Vec3;
  /** Roll, pitch, yaw about fixed axes [rad], as in URDF. */
  rpy: Vec3;
}

export interface HelloMessage {
  type: "hello";
  protocol: number;
  server: string;
  source: "live" | "bag";
  title: string;
  may_drive: boolean;
  may_control_simulation: boolean;
  may_record: boolean;
  /** Deflections of controls by key, and the meaning of the other keys; see `teleop/key_layout.py`. */
  keys: Record<string, Record<string, number>>;
  action_keys: Record<string, string>;
  controls: string[];
  frame_rate: number;
}

export interface ErrorMessage {
  type: "error";
  code: string;
  message: string;
}

export interface Soil {
  id: number;
  name: string;
  color: Rgb;
}

/** The grid and the surface that changes are compared with. Matrices are in grid_map order: (0, 0) is +x, +y. */
export interface SiteMessage {
  type: "site";
  run_id: number;
  rows: number;
  cols: number;
  /** Side of a cell [m]. */
  cell: number;
  /** Elevations of the first keyframe of the run that the server received [m], f32, rows * cols. */
  reference: Uint8Array;
  /** Design elevations [m], f32, NaN where there is none; null without a design. */
  design: Uint8Array | null;
  soils: Soil[];
}

export interface Visual {
  kind: "box" | "cylinder" | "sphere" | "mesh";
  size?: Vec3;
  radius?: number;
  length?: number;
  /** Binary glTF. */
  glb?: Uint8Array;
  origin: Origin;
  color: Rgba;
}

export interface Link {
  name: string;
  visuals: Visual[];
}

export interface Mimic {
  joint: string;
  multiplier: number;
  offset: number;
}

export interface Joint {
  name: string;
  type: "fixed" | "revolute" | "continuous" | "prismatic";
  parent: string;
  child: string;
  origin: Origin;
  axis: Vec3;
  lower: number | null;
  upper: number | null;
  mimic?: Mimic;
}

/** A crawler track: its shoes run around two wheels, `joint` is the sprocket. */
export interface Track {
  joint: string;
  link: string;
  /** Lateral position of the middle of the track [m]. */
  y: number;
  axle_distance: number;
  radius: number;
  shoe_count: number;
  /** Length, width and thickness of a shoe [m]. */
  shoe_size: Vec3;
  color: Rgba;
}

export interface MachineModel {
  name: string;
  links: Link[];
  joints: Joint[];
  tracks: Track[];
  engine: { rated_power: number } | null;
  /** Maximum pressures of moving and of locked cylinders [Pa]; null if they are not known. */
  hydraulics: { main_relief_pressure: number; port_relief_pressure: number } | null;
  /** Mesh of a shoe as binary glTF, x forward and z out of the track, origin on the pitch line; null without one. */
  shoe: Uint8Array | null;
}

export interface MachineMessage {
  type: "machine";
  id: string;
  namespace: string;
  model: MachineModel;
  /** Control that moves each joint, with its direction, as `left_x` or `-left_y`. */
  levers: Record<string, string>;
  pattern: "iso" | "sae";
}

export interface MachineGoneMessage {
  type: "machine_gone";
  id: string;
}

export interface Gauges {
  payload?: { fill: number; mass: number; bank_m3: number };
  cylinders?: Record<string, { cap: number; rod: number; force: number; length: number }>;
  joints?: Record<string, number>;
  applied?: Record<string, number>;
  /** Emergency stop as the machine reports it; null: it reports nothing. */
  stopped?: boolean | null;
  /** Whether a press was published that the machine has not reported yet. */
  stop_requested?: boolean;
  /** Whether the machine ignores levers until they have been at rest: it, or their messages, stood still meanwhile. */
  levers_ignored?: boolean;
  phase?: string;
  /** Travel speed [m/s]. */
  speed?: number;
}

export interface MachineFrame {
  id: string;
  time: number;
  /** Joint values in the order of `MachineModel.joints` [rad or m], f32. */
  positions: Uint8Array;
  velocities: Uint8Array;
  /** Position [m] and quaternion x, y, z, w of the root link; null if the model has joints from `map`. */
  base: [number, number, number, number, number, number, number] | null;
  /** Engine load, 0 to 1. */
  load: number;
  gauges: Gauges;
}

export interface TileBlock {
  count: number;
  /** Tile numbers, u32; number = tile row * tile columns + tile column. */
  index: Uint8Array;
  /** TILE_BYTES for each tile. */
  data: Uint8Array;
}

export interface ParticleBlock {
  count: number;
  /** Position = origin + scale * u16 value [m]. */
  origin: Vec3;
  scale: Vec3;
  data: Uint8Array;
}

export interface FrameMessage {
  type: "frame";
  seq: number;
  run_id: number;
  /** Last tick; -1 while none is known. */
  tick: number;
  /** Simulation time [s]; null while none is known. */
  time: number | null;
  paused: boolean;
  /** Real-time factor. */
  rtf: number;
  latency_ms: number;
  tiles: TileBlock;
  /** Absent if the particles have not changed. */
  particles?: ParticleBlock;
  machines: MachineFrame[];
  /** Accounts of the ledger [mm^3]. */
  ledger: Record<string, number>;
  status: Record<string, string | number | boolean>;
}

export interface ControlMessage {
  type: "control";
  drivers: Record<string, { id: string; is_you: boolean }>;
}

export interface TimelineMessage {
  type: "timeline";
  start: number;
  end: number;
  time: number;
  rate: number;
  paused: boolean;
}

export interface BagsMessage {
  type: "bags";
  names: string[];
}

export interface RecordingMessage {
  type: "recording";
  on: boolean;
  path: string;
  bytes: number;
  /** Why the recording has failed, until the next one starts; empty if it has not. */
  failure: string;
}

export interface PongMessage {
  type: "pong";
  id: number;
}

/** Camera of a picture: a view of a machine (angles in degrees, empty machine: the first), or a fixed pose. */
export type PictureCamera =
  | {
      view: "orbit" | "cab" | "top" | "bucket";
      machine: string;
      azimuth?: number;
      elevation?: number;
      distance?: number;
      fov?: number;
    }
  | { position: Vec3; target: Vec3; up: Vec3; fov: number };

/** To pages that only draw pictures (`?renderer=1`), which answer with a `PictureMessage`. */
export interface RenderMessage {
  type: "render";
  id: number;
  /** Simulation time [s]. */
  time: number;
  camera: PictureCamera;
  width: number;
  height: number;
  /** `rgb`: 8 bit, row by row from the top; `none`: smoke and dust move to this time, nothing is drawn. */
  format: "rgb" | "png" | "jpeg" | "none";
}

/** Answer of a page to `render`, as msgpack. */
export interface PictureMessage {
  type: "picture";
  id: number;
  width: number;
  height: number;
  data: Uint8Array;
  /** Of the camera [m], map frame. */
  position: Vec3;
  /** Quaternion x, y, z, w of the camera's optical frame (x right, y down, z forward) in the map frame. */
  rotation: [number, number, number, number];
  /** Vertical angle of view [deg]. */
  fov: number;
}

export type ServerMessage =
  | HelloMessage
  | ErrorMessage
  | SiteMessage
  | MachineMessage
  | MachineGoneMessage
  | FrameMessage
  | ControlMessage
  | TimelineMessage
  | BagsMessage
  | RecordingMessage
  | PongMessage
  | RenderMessage;

export type PageMessage =
  | { type: "login"; token: string; protocol: number; source: "live" | { bag: string } }
  | { type: "ack"; seq: number }
  | { type: "take_control"; machine: string; force?: boolean }
  | { type: "release_control" }
  | { type: "drive"; machine: string; held: string[]; deflections: Record<string, number>; time: number }
  | { type: "speed"; value: number }
  | { type: "emergency_stop"; machine: string; pressed: boolean }
  | { type: "simulation"; action: "pause" | "continue" | "step" | "reset" }
  | { type: "record"; on: boolean }
  | { type: "playback"; action: "play" | "pause" | "seek" | "rate"; value?: number }
  | { type: "list_bags" }
  | { type: "ping"; id: number }
  | { type: "failure"; message: string };
