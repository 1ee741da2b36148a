/** The layers of the terrain on the GPU: float heights, packed cells, reference and design. */

import {
  DataTexture,
  FloatType,
  NearestFilter,
  NoColorSpace,
  RedFormat,
  RGBAFormat,
  UnsignedByteType,
  type WebGLRenderer,
} from "three";
import { TILE } from "../protocol";
import type { TerrainState } from "../world_state";

/** Rows and columns [cells]: first ones inclusive, last ones exclusive. */
export interface CellRange {
  row0: number;
  col0: number;
  row1: number;
  col1: number;
}

/** Textures have the rows of the matrices: texel (column, row). */
export class HeightTextures {
  readonly height: DataTexture;
  /** Soil, moisture [%], low and high byte of the loose depth [mm]. */
  readonly cells: DataTexture;
  readonly reference: DataTexture;
  readonly design: DataTexture | null;
  /** Lowest and highest elevation of the reference [m]. */
  readonly referenceRange: [number, number];
  private version = -1;
  private readonly changed: CellRange = { row0: 0, col0: 0, row1: 0, col1: 0 };

  constructor(readonly terrain: TerrainState) {
    const { rows, cols } = terrain;
    this.height = floatTexture(terrain.height, rows, cols);
    this.cells = new DataTexture(terrain.cells, cols, rows, RGBAFormat, UnsignedByteType);
    prepare(this.cells);
    this.reference = floatTexture(terrain.reference, rows, cols);
    this.design = terrain.design ? floatTexture(terrain.design, rows, cols) : null;
    this.referenceRange = range(terrain.reference);
  }

  /** Upload the tiles that changed since the last call; return the range of cells that contains them, or null. */
  upload(renderer: WebGLRenderer): CellRange | null {
    const { terrain, changed } = this;
    if (terrain.version === this.version) return null;
    const isFirst = this.version < 0;
    this.version = terrain.version;
    changed.row0 = changed.col0 = Infinity;
    changed.row1 = changed.col1 = -Infinity;
    if (isFirst) {
      terrain.dirty.fill(0);
      Object.assign(changed, { row0: 0, col0: 0, row1: terrain.rows, col1: terrain.cols });
      return changed;
    }
    for (let tileRow = 0; tileRow < terrain.tileRows; tileRow++) this.uploadTileRow(renderer, tileRow);
    return changed.row1 > changed.row0 ? changed : null;
  }

  /** Upload each run of adjacent changed tiles by one call for each texture. */
  private uploadTileRow(renderer: WebGLRenderer, tileRow: number): void {
    const { terrain, changed } = this;
    const { rows, cols, tileCols, dirty } = terrain;
    const first = tileRow * tileCols;
    for (let tile = 0; tile < tileCols; tile++) {
      if (!dirty[first + tile]) continue;
      const start = tile;
      while (tile < tileCols && dirty[first + tile]) dirty[first + tile++] = 0;
      const row0 = tileRow * TILE;
      const col0 = start * TILE;
      const row1 = Math.min(row0 + TILE, rows);
      const col1 = Math.min(tile * TILE, cols);
      uploadRange(renderer, this.height, row0, col0, row1, col1);
      uploadRange(renderer, this.cells, row0, col0, row1, col1);
      changed.row0 = Math.min(changed.row0, row0);
      changed.col0 = Math.min(changed.col0, col0);
      changed.row1 = Math.max(changed.row1, row1);
      changed.col1 = Math.max(changed.col1, col1);
    }
  }

  dispose(): void {
    this.height.dispose();
    this.cells.dispose();
    this.reference.dispose();
    this.design?.dispose();
  }
}

function floatTexture(data: Float32Array, rows: number, cols: number): DataTexture {
  const texture = new DataTexture(data, cols, rows, RedFormat, FloatType);
  prepare(texture);
  return texture;
}

function prepare(texture: DataTexture): void {
  texture.minFilter = texture.magFilter = NearestFilter; // linear filtering of floats is an extension
  texture.generateMipmaps = false;
  texture.colorSpace = NoColorSpace;
  texture.unpackAlignment = 1;
  texture.needsUpdate = true;
}

function range(values: Float32Array): [number, number] {
  let low = Infinity;
  let high = -Infinity;
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return [low, high];
}

/** Upload a rectangle straight from the array of the whole texture. */
function uploadRange(
  renderer: WebGLRenderer,
  texture: DataTexture,
  row0: number,
  col0: number,
  row1: number,
  col1: number,
): void {
  const gl = renderer.getContext() as WebGL2RenderingContext;
  const handle = (renderer.properties.get(texture) as { __webglTexture?: WebGLTexture }).__webglTexture;
  if (!handle) return; // three uploads the whole texture at its first use
  const { state } = renderer;
  state.bindTexture(gl.TEXTURE_2D, handle);
  state.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
  state.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
  state.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  state.pixelStorei(gl.UNPACK_ROW_LENGTH, texture.image.width);
  state.pixelStorei(gl.UNPACK_SKIP_PIXELS, col0);
  state.pixelStorei(gl.UNPACK_SKIP_ROWS, row0);
  const isFloat = texture.type === FloatType;
  gl.texSubImage2D(
    gl.TEXTURE_2D,
    0,
    col0,
    row0,
    col1 - col0,
    row1 - row0,
    isFloat ? gl.RED : gl.RGBA,
    isFloat ? gl.FLOAT : gl.UNSIGNED_BYTE,
    texture.image.data as ArrayBufferView,
  );
  state.pixelStorei(gl.UNPACK_ROW_LENGTH, 0);
  state.pixelStorei(gl.UNPACK_SKIP_PIXELS, 0);
  state.pixelStorei(gl.UNPACK_SKIP_ROWS, 0);
  state.unbindTexture();
}
