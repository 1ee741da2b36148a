/** Tileable textures of bare soil and of grass, generated on the GPU when the page starts. */

import {
  HalfFloatType,
  LinearFilter,
  LinearMipmapLinearFilter,
  RepeatWrapping,
  RGBAFormat,
  UnsignedByteType,
  WebGLRenderTarget,
  type Texture,
  type WebGLRenderer,
} from "three";
import { FullscreenPass } from "../fullscreen_pass";

const NOISE_GLSL = /* glsl */ `
uint hash(uvec2 v) {
  v = v * 1664525u + 1013904223u;
  v.x += v.y * 1664525u; v.y += v.x * 1664525u;
  v ^= v >> 16u;
  v.x += v.y * 1664525u; v.y += v.x * 1664525u;
  return v.x ^ (v.y >> 16u);
}
vec3 random(ivec2 cell, int period, uint seed) {
  ivec2 c = ((cell % period) + period) % period;
  uint h = hash(uvec2(c) + seed * 7919u);
  return vec3(h & 1023u, (h >> 10u) & 1023u, (h >> 20u) & 1023u) / 1023.0;
}
float valueNoise(vec2 uv, int period, uint seed) {
  vec2 p = uv * float(period);
  ivec2 i = ivec2(floor(p));
  vec2 f = fract(p);
  f = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
  float a = random(i, period, seed).x, b = random(i + ivec2(1, 0), period, seed).x;
  float c = random(i + ivec2(0, 1), period, seed).x, d = random(i + ivec2(1, 1), period, seed).x;
  return mix(mix(a, b, f.x), mix(c, d, f.x), f.y);
}
float fbm(vec2 uv, int period, int octaves, uint seed) {
  float sum = 0.0, amplitude = 0.5;
  for (int k = 0; k < octaves; k++) {
    sum += amplitude * valueNoise(uv, period << k, seed + uint(k));
    amplitude *= 0.5;
  }
  return sum;
}
// Height of round lumps of varied size that lie on a plane.
float lumps(vec2 uv, int period, float share, uint seed) {
  vec2 p = uv * float(period);
  ivec2 i = ivec2(floor(p));
  float top = 0.0;
  for (int dy = -1; dy <= 1; dy++) for (int dx = -1; dx <= 1; dx++) {
    ivec2 cell = i + ivec2(dx, dy);
    vec3 r = random(cell, period, seed);
    vec2 centre = vec2(cell) + 0.15 + 0.7 * r.xy;
    float size = r.z < share ? 0.25 + 0.45 * r.z / share : 0.0;
    vec2 d = p - centre;
    d = vec2(d.x + 0.35 * (r.y - 0.5) * d.y, d.y * (0.8 + 0.4 * r.x));
    top = max(top, size * sqrt(max(0.0, 1.0 - dot(d, d) / max(size * size, 1e-4))));
  }
  return top;
}
`;

const HEIGHTS = /* glsl */ `
uniform float size; // texels along each side
${NOISE_GLSL}
layout(location = 0) out vec4 heights; // soil, grass, and a low-frequency pattern of each
void main() {
  vec2 uv = gl_FragCoord.xy / size;
  float soil = 0.42 * fbm(uv, 6, 6, 1u)
    + 0.30 * lumps(uv, 8, 0.30, 11u) + 0.30 * lumps(uv, 17, 0.5, 12u)
    + 0.20 * lumps(uv, 37, 0.7, 13u) + 0.10 * lumps(uv, 79, 0.85, 14u);
  vec2 bend = vec2(fbm(uv, 5, 3, 31u), fbm(uv, 5, 3, 37u)) - 0.5;
  vec2 w = uv + 0.05 * bend;
  float blades = max(max(lumps(vec2(w.x, w.y), 46, 0.8, 21u), 0.8 * lumps(w + 0.37, 71, 0.8, 22u)), 0.6 * lumps(w, 117, 0.9, 23u));
  float grass = 0.45 * fbm(w, 9, 5, 24u) + 0.55 * blades;
  heights = vec4(soil, grass, fbm(uv, 4, 5, 41u), fbm(uv + 0.3 * bend, 3, 6, 51u));
}
`;

const NORMALS = /* glsl */ `
uniform highp sampler2D heightMap;
layout(location = 0) out vec4 soil;  // slope (0.5 is level), height, pattern
layout(location = 1) out vec4 grass;
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  int last = textureSize(heightMap, 0).x - 1; // a power of two, less 1
  vec4 here = texelFetch(heightMap, at, 0);
  vec4 right = texelFetch(heightMap, (at + ivec2(1, 0)) & last, 0) - texelFetch(heightMap, (at - ivec2(1, 0)) & last, 0);
  vec4 up = texelFetch(heightMap, (at + ivec2(0, 1)) & last, 0) - texelFetch(heightMap, (at - ivec2(0, 1)) & last, 0);
  float scale = float(last + 1) / 512.0;
  soil = vec4(0.5 - 9.0 * scale * vec2(right.x, up.x), here.x, here.z);
  grass = vec4(0.5 - 6.0 * scale * vec2(right.y, up.y), here.y, here.w);
}
`;

/** Red and green: slope; blue: height; alpha: a pattern of low frequency. */
export class DetailTextures {
  private readonly target: WebGLRenderTarget;

  /**
   * @param size texels along each side, a power of two.
   * @param anisotropy texture samples toward the horizon.
   */
  constructor(
    private readonly size: number,
    anisotropy: number,
  ) {
    this.target = new WebGLRenderTarget(size, size, {
      count: 2,
      depthBuffer: false,
      format: RGBAFormat,
      type: UnsignedByteType,
      wrapS: RepeatWrapping,
      wrapT: RepeatWrapping,
      magFilter: LinearFilter,
      minFilter: LinearMipmapLinearFilter,
      generateMipmaps: true,
      anisotropy,
    });
  }

  get soil(): Texture {
    return this.target.textures[0]!;
  }

  get grass(): Texture {
    return this.target.textures[1]!;
  }

  generate(renderer: WebGLRenderer): void {
    const { size } = this;
    const heights = new WebGLRenderTarget(size, size, { depthBuffer: false, type: HalfFloatType });
    const first = new FullscreenPass(HEIGHTS, { size: { value: size } });
    const second = new FullscreenPass(NORMALS, { heightMap: { value: heights.texture } });
    first.render(renderer, heights);
    second.render(renderer, this.target);
    first.dispose();
    second.dispose();
    heights.dispose();
  }
}
