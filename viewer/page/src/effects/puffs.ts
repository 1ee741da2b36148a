/**
 * A pool of puffs (smoke, dust): camera-facing sprites whose course the GPU computes from what was written when they
 * were made. Nothing is written for a puff after that; the oldest one is reused.
 */

import {
  DynamicDrawUsage,
  Float32BufferAttribute,
  InstancedBufferGeometry,
  InstancedInterleavedBuffer,
  InterleavedBufferAttribute,
  Mesh,
  ShaderMaterial,
  Sphere,
  Vector3,
  type Texture,
} from "three";
import { SUN } from "../environment";
import { HEIGHT_GLSL, type HeightUniforms } from "../terrain/height_glsl";

/** Floats of a puff. */
const STRIDE = 16;

const VERTEX = /* glsl */ `
attribute vec4 start;    // position [m], time of birth [s]
attribute vec4 velocity; // [m/s], life [s]
attribute vec4 look;     // first and last diameter [m], opacity, random number
attribute vec4 tint;     // colour, rise [m/s^2]
uniform float time;
uniform vec3 wind;
varying vec2 vCorner;
varying vec4 vTint;
varying vec2 vSeed;
varying vec3 vPlace;

void main() {
  float age = time - start.w;
  float share = age / velocity.w;
  vCorner = position.xy;
  if (share >= 1.0 || share < 0.0) {
    gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
    return;
  }
  float drag = 2.2;
  float along = (1.0 - exp(-drag * age)) / drag;
  vec3 centre = start.xyz + velocity.xyz * along + wind * (age - along) + vec3(0.0, 0.0, 0.5 * tint.w * age * age);
  float size = mix(look.x, look.y, sqrt(share));
  float angle = 6.2832 * look.w + (look.w - 0.5) * 1.6 * age;
  vec2 corner = mat2(cos(angle), sin(angle), -sin(angle), cos(angle)) * position.xy;
  vec3 right = vec3(viewMatrix[0].x, viewMatrix[1].x, viewMatrix[2].x);
  vec3 up = vec3(viewMatrix[0].y, viewMatrix[1].y, viewMatrix[2].y);
  vPlace = centre + 0.5 * size * (right * corner.x + up * corner.y);
  vCorner = corner;
  float fade = smoothstep(0.0, 0.12, share) * (1.0 - share) * (1.0 - 0.5 * share);
  vTint = vec4(tint.rgb, look.z * fade);
  vSeed = vec2(look.w, 0.35 + 0.4 * share);
  gl_Position = projectionMatrix * viewMatrix * vec4(vPlace, 1.0);
}
`;

const FRAGMENT = /* glsl */ `
${HEIGHT_GLSL}
uniform sampler2D noiseMap;
uniform vec3 sunView;
varying vec2 vCorner;
varying vec4 vTint;
varying vec2 vSeed;
varying vec3 vPlace;

void main() {
  float r = dot(vCorner, vCorner);
  if (r > 1.0) discard;
  vec2 at = vCorner * 0.11 + vec2(vSeed.x * 7.0, vSeed.x * 13.0);
  float noise = texture2D(noiseMap, at).a * 0.6 + texture2D(noiseMap, at * 2.7).a * 0.4;
  float body = (1.0 - r) * smoothstep(vSeed.y - 0.25, vSeed.y + 0.45, noise + 0.45 * (1.0 - r));
  // Fade into the ground instead of a hard line.
  float above = vPlace.z - bilinearHeight(vPlace.xy);
  body *= smoothstep(0.0, 0.3, above);
  vec3 normal = vec3(vCorner, sqrt(max(1.0 - r, 0.0)));
  float light = 0.62 + 0.42 * max(dot(normal, sunView), 0.0) + 0.12 * (noise - 0.5);
  gl_FragColor = vec4(vTint.rgb * light, clamp(vTint.a * body, 0.0, 1.0));
  #include <colorspace_fragment>
}
`;

/** A puff to be made; a source reuses one for all that it emits. Colours are linear, as displayed in full light. */
export class Puff {
  readonly position = new Vector3();
  /** [m/s] */
  readonly velocity = new Vector3();
  /** [s] */
  life = 1;
  /** First and last diameter [m]. */
  readonly size: [number, number] = [0, 0];
  opacity = 0;
  readonly color: [number, number, number] = [0, 0, 0];

  /** @param rise upward acceleration [m/s^2]. */
  constructor(readonly rise: number) {}
}

export class Puffs {
  readonly mesh: Mesh;
  private readonly values: Float32Array;
  private readonly buffer: InstancedInterleavedBuffer;
  private readonly material: ShaderMaterial;
  private readonly sunView = new Vector3();
  private next = 0;
  private time = 0;
  private last = 0;
  private lastEnd = 0;

  constructor(
    private readonly capacity: number,
    noise: Texture,
    height: HeightUniforms,
  ) {
    this.values = new Float32Array(STRIDE * capacity);
    for (let i = 0; i < capacity; i++) this.values[STRIDE * i + 7] = 1e-3;
    this.values.fill(-1e6, 3, 4);
    this.buffer = new InstancedInterleavedBuffer(this.values, STRIDE);
    this.buffer.setUsage(DynamicDrawUsage);
    const geometry = new InstancedBufferGeometry();
    geometry.setAttribute("position", new Float32BufferAttribute([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0], 3));
    geometry.setIndex([0, 1, 2, 0, 2, 3]);
    ["start", "velocity", "look", "tint"].forEach((name, i) => {
      geometry.setAttribute(name, new InterleavedBufferAttribute(this.buffer, 4, 4 * i));
    });
    geometry.boundingSphere = new Sphere(new Vector3(), Infinity);
    geometry.instanceCount = 0;
    this.material = new ShaderMaterial({
      vertexShader: VERTEX,
      fragmentShader: FRAGMENT,
      uniforms: {
        ...height,
        time: { value: 0 },
        wind: { value: new Vector3(0.55, 0.3, 0.05) },
        noiseMap: { value: noise },
        sunView: { value: this.sunView },
      },
      transparent: true,
      depthWrite: false,
      toneMapped: false,
    });
    this.mesh = new Mesh(geometry, this.material);
    this.mesh.frustumCulled = false;
    this.mesh.renderOrder = 30;
    this.mesh.onBeforeRender = (_renderer, _scene, camera) => {
      this.sunView.copy(SUN).transformDirection(camera.matrixWorldInverse);
    };
  }

  emit(puff: Puff): void {
    const at = STRIDE * this.next;
    const { values } = this;
    const { position, velocity, size, color } = puff;
    values[at] = position.x;
    values[at + 1] = position.y;
    values[at + 2] = position.z;
    values[at + 3] = this.time;
    values[at + 4] = velocity.x;
    values[at + 5] = velocity.y;
    values[at + 6] = velocity.z;
    values[at + 7] = puff.life;
    values[at + 8] = size[0];
    values[at + 9] = size[1];
    values[at + 10] = puff.opacity;
    values[at + 11] = Math.random();
    values[at + 12] = color[0];
    values[at + 13] = color[1];
    values[at + 14] = color[2];
    values[at + 15] = puff.rise;
    this.next = (this.next + 1) % this.capacity;
    this.last++;
    this.lastEnd = Math.max(this.lastEnd, this.time + puff.life);
    const geometry = this.mesh.geometry as InstancedBufferGeometry;
    geometry.instanceCount = Math.min(Math.max(geometry.instanceCount, this.last), this.capacity);
    this.buffer.needsUpdate = true;
  }

  /** Continue by `dt` [s]; puffs stand still while it is 0. */
  update(dt: number): void {
    this.time += dt;
    this.material.uniforms["time"]!.value = this.time;
    this.mesh.visible = this.time < this.lastEnd;
  }
}
