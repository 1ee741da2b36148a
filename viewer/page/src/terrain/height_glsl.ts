/** GLSL that reads the height texture; for vertex and fragment shaders. */

import { Vector2, Vector4, type IUniform, type Texture } from "three";

/** Uniforms of `HEIGHT_GLSL`, shared by all materials that stand on the terrain. */
export interface HeightUniforms {
  [name: string]: IUniform;
  heightMap: IUniform<Texture | null>;
  /** Rows, columns, side of a cell [m], mean elevation of the border [m]. */
  grid: IUniform<Vector4>;
  /** Half of the length of the map along x and y, between the outermost cell centres [m]. */
  halfSize: IUniform<Vector2>;
}

export function heightUniforms(): HeightUniforms {
  return {
    heightMap: { value: null },
    grid: { value: new Vector4(2, 2, 1, 0) },
    halfSize: { value: new Vector2(1, 1) },
  };
}

/**
 * `terrainHeight` passes through the height of each cell centre (Catmull-Rom between them); outside of the map the
 * ground continues at the border's height and turns into hills.
 */
export const HEIGHT_GLSL = /* glsl */ `
uniform highp sampler2D heightMap;
uniform vec4 grid;
uniform vec2 halfSize;

// Column and row of a position [m], as fractions.
vec2 gridPosition(vec2 xy) {
  return vec2(0.5 * (grid.y - 1.0) - xy.y / grid.z, 0.5 * (grid.x - 1.0) - xy.x / grid.z);
}

float cellHeight(ivec2 colRow) {
  return texelFetch(heightMap, clamp(colRow, ivec2(0), ivec2(grid.yx) - 1), 0).r;
}

float bilinearHeight(vec2 xy) {
  vec2 at = gridPosition(xy);
  ivec2 i = ivec2(floor(at));
  vec2 f = at - vec2(i);
  return mix(
    mix(cellHeight(i), cellHeight(i + ivec2(1, 0)), f.x),
    mix(cellHeight(i + ivec2(0, 1)), cellHeight(i + ivec2(1, 1)), f.x),
    f.y);
}

vec4 cubicWeights(float t) {
  return 0.5 * vec4(
    t * (-1.0 + t * (2.0 - t)),
    2.0 + t * t * (-5.0 + 3.0 * t),
    t * (1.0 + t * (4.0 - 3.0 * t)),
    t * t * (t - 1.0));
}

float smoothHeight(vec2 xy) {
  vec2 at = gridPosition(xy);
  ivec2 i = ivec2(floor(at));
  vec2 f = at - vec2(i);
  vec4 wx = cubicWeights(f.x);
  vec4 wy = cubicWeights(f.y);
  float sum = 0.0;
  for (int r = 0; r < 4; r++) {
    ivec2 j = i + ivec2(-1, r - 1);
    sum += wy[r] * (wx.x * cellHeight(j) + wx.y * cellHeight(j + ivec2(1, 0))
      + wx.z * cellHeight(j + ivec2(2, 0)) + wx.w * cellHeight(j + ivec2(3, 0)));
  }
  return sum;
}

// Distance outside of the map [m].
float outsideDistance(vec2 xy) {
  return length(max(abs(xy) - halfSize, 0.0));
}

float hills(vec2 xy, float outside) {
  float wave = sin(0.013 * xy.x + 1.3) * sin(0.011 * xy.y + 0.4) + 0.6 * sin(0.023 * xy.x - 0.019 * xy.y)
    + 0.35 * sin(0.051 * xy.x + 0.037 * xy.y + 2.0);
  float gentle = 0.5 * (sin(0.11 * xy.x + 0.7) * sin(0.09 * xy.y) + 0.4 * sin(0.31 * xy.x + 0.22 * xy.y));
  return gentle * smoothstep(4.0, 40.0, outside) + (4.0 + 7.0 * wave) * smoothstep(60.0, 420.0, outside)
    + 26.0 * smoothstep(300.0, 1100.0, outside) * (0.6 + 0.4 * sin(0.0061 * xy.x + 0.0047 * xy.y));
}

float outsideHeight(vec2 xy, float outside) {
  float border = bilinearHeight(clamp(xy, -halfSize, halfSize));
  return mix(border, grid.w, smoothstep(0.0, 12.0, outside)) + hills(xy, outside);
}

float terrainHeight(vec2 xy) {
  float outside = outsideDistance(xy);
  return outside > 0.0 ? outsideHeight(xy, outside) : smoothHeight(xy);
}

float coarseHeight(vec2 xy) {
  float outside = outsideDistance(xy);
  return outside > 0.0 ? outsideHeight(xy, outside) : bilinearHeight(xy);
}
`;
