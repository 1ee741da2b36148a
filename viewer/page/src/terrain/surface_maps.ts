/** Maps derived from the layers on the GPU, of one texel for each cell, which the hardware filters. */

import {
  HalfFloatType,
  LinearFilter,
  RGBAFormat,
  UnsignedByteType,
  Vector3,
  WebGLRenderTarget,
  type Texture,
  type WebGLRenderer,
} from "three";
import { FullscreenPass } from "../fullscreen_pass";
import type { Soil } from "../protocol";
import { HEIGHT_GLSL, type HeightUniforms } from "./height_glsl";
import type { CellRange, HeightTextures } from "./height_textures";

/** Distance that occlusion looks around a cell [cells]. */
const REACH = 14;

/** Largest number of kinds of soil on a site. */
export const MAX_SOILS = 16;

const FRAGMENT = /* glsl */ `
${HEIGHT_GLSL}
uniform highp sampler2D cellMap;
uniform highp sampler2D referenceMap;
uniform vec3 soilColors[${MAX_SOILS}];
layout(location = 0) out vec4 shape;   // dz/dx, dz/dy, openness to the sky, height above the reference [m]
layout(location = 1) out vec4 surface; // colour of the soil (square root of linear), share of disturbed ground
layout(location = 2) out vec4 state;   // moisture 0..1, loose depth [m]

float openness(ivec2 at, float height) {
  float sum = 0.0;
  for (int k = 0; k < 8; k++) {
    float angle = 0.3927 + 0.7854 * float(k);
    vec2 direction = vec2(cos(angle), sin(angle));
    float horizon = 0.0;
    for (int n = 0; n < 4; n++) {
      float distance = float(n == 0 ? 1 : n == 1 ? 3 : n == 2 ? 7 : 13);
      ivec2 step = ivec2(round(direction * distance));
      float rise = cellHeight(at + step) - height;
      horizon = max(horizon, rise / (length(vec2(step)) * grid.z));
    }
    sum += horizon * horizon / (1.0 + horizon * horizon); // squared sine of the horizon's elevation
  }
  return 1.0 - sum / 8.0;
}

void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  float height = cellHeight(at);
  float east = cellHeight(at + ivec2(1, 0));
  float west = cellHeight(at - ivec2(1, 0));
  float south = cellHeight(at + ivec2(0, 1));
  float north = cellHeight(at - ivec2(0, 1));
  float change = height - texelFetch(referenceMap, at, 0).r;
  vec4 cell = texelFetch(cellMap, at, 0) * 255.0;
  float loose = (cell.z + 256.0 * cell.w) * 0.001;
  float disturbed = max(smoothstep(0.004, 0.04, loose), smoothstep(0.015, 0.06, abs(change)));
  // Columns run toward -y, rows toward -x.
  shape = vec4((north - south) / (2.0 * grid.z), (west - east) / (2.0 * grid.z), openness(at, height), change);
  surface = vec4(sqrt(soilColors[min(int(cell.x + 0.5), ${MAX_SOILS - 1})]), disturbed);
  state = vec4(cell.y / 100.0, loose, 0.0, 0.0);
}
`;

export class SurfaceMaps {
  private readonly target: WebGLRenderTarget;
  private readonly pass: FullscreenPass;
  /** Linear colours by soil id. */
  readonly soilColors: Vector3[];

  constructor(textures: HeightTextures, uniforms: HeightUniforms, soils: readonly Soil[]) {
    const { rows, cols } = textures.terrain;
    this.target = new WebGLRenderTarget(cols, rows, {
      count: 3,
      depthBuffer: false,
      format: RGBAFormat,
      type: HalfFloatType,
      minFilter: LinearFilter,
      magFilter: LinearFilter,
    });
    this.target.textures[1]!.type = UnsignedByteType;
    this.target.scissorTest = true;
    this.soilColors = soilPalette(soils);
    this.pass = new FullscreenPass(FRAGMENT, {
      ...uniforms,
      cellMap: { value: textures.cells },
      referenceMap: { value: textures.reference },
      soilColors: { value: this.soilColors },
    });
  }

  get shape(): Texture {
    return this.target.textures[0]!;
  }

  get surface(): Texture {
    return this.target.textures[1]!;
  }

  get state(): Texture {
    return this.target.textures[2]!;
  }

  /** Derive the maps where layers have changed. */
  update(renderer: WebGLRenderer, changed: CellRange): void {
    const { width, height } = this.target;
    const col0 = Math.max(changed.col0 - REACH, 0);
    const row0 = Math.max(changed.row0 - REACH, 0);
    const col1 = Math.min(changed.col1 + REACH, width);
    const row1 = Math.min(changed.row1 + REACH, height);
    this.target.scissor.set(col0, row0, col1 - col0, row1 - row0);
    this.pass.render(renderer, this.target);
  }

  dispose(): void {
    this.target.dispose();
    this.pass.dispose();
  }
}

/** Return linear colours by soil id. */
function soilPalette(soils: readonly Soil[]): Vector3[] {
  const colors = Array.from({ length: MAX_SOILS }, () => new Vector3(0.15, 0.1, 0.06));
  for (const { id, color } of soils) {
    colors[id]?.set(...(color.map((value) => Math.pow(value, 2.2)) as [number, number, number]));
  }
  return colors;
}
