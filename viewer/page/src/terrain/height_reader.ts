/** Reading heights back from the texture that is drawn. */

import { WebGLRenderTarget, Vector2, type WebGLRenderer } from "three";
import { FullscreenPass } from "../fullscreen_pass";
import type { HeightTextures } from "./height_textures";

/** The bits of the height are written as four bytes, because not every device can render to floats. */
const FRAGMENT = /* glsl */ `
uniform highp sampler2D heightMap;
uniform vec2 first; // column, row
layout(location = 0) out vec4 bytes;
void main() {
  uint bits = floatBitsToUint(texelFetch(heightMap, ivec2(gl_FragCoord.xy) + ivec2(first), 0).r);
  bytes = vec4(bits & 255u, (bits >> 8u) & 255u, (bits >> 16u) & 255u, bits >> 24u) / 255.0;
}
`;

/** Return the heights of a rectangle of cells [m], row by row. */
export function readHeights(
  renderer: WebGLRenderer,
  textures: HeightTextures,
  row0: number,
  col0: number,
  rows: number,
  cols: number,
): number[] {
  const target = new WebGLRenderTarget(cols, rows, { depthBuffer: false });
  const pass = new FullscreenPass(FRAGMENT, {
    heightMap: { value: textures.height },
    first: { value: new Vector2(col0, row0) },
  });
  pass.render(renderer, target);
  const bytes = new Uint8Array(4 * rows * cols);
  renderer.readRenderTargetPixels(target, 0, 0, cols, rows, bytes);
  pass.dispose();
  target.dispose();
  return Array.from(new Float32Array(bytes.buffer));
}
