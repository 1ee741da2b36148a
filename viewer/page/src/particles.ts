/** Particles as instanced lumps. The GPU reads the bytes of the message as they are. */

import {
  BufferGeometry,
  DynamicDrawUsage,
  Float32BufferAttribute,
  IcosahedronGeometry,
  InstancedBufferGeometry,
  InstancedInterleavedBuffer,
  InterleavedBufferAttribute,
  Mesh,
  MeshDepthMaterial,
  MeshStandardMaterial,
  RGBADepthPacking,
  Sphere,
  Vector3,
  type IUniform,
  type Texture,
  type WebGLProgramParametersWithUniforms,
} from "three";
import { DIAMETER_UNIT, PARTICLE_BYTES } from "./protocol";
import { MAX_SOILS } from "./terrain/surface_maps";
import type { ParticleState, WorldState } from "./world_state";

/** Longest extrapolation by the velocity [s]. */
const MAX_EXTRAPOLATION = 0.08;

/** Lumps are drawn larger than their spheres, whose volume is that of the soil, so that heaps look closed. */
const DRAWN_SIZE = 1.16;

const VERTEX_GLSL = /* glsl */ `
attribute vec4 place;  // u16 x, y, z, id
attribute vec4 motion; // i16 vx, vy, vz [mm/s] and two bytes, all as u16
uniform vec3 cloudOrigin;
uniform vec3 cloudScale;
uniform float ahead;   // [s]

vec3 lumpPosition;
vec3 lumpNormal;
float lumpSoil;
vec3 lumpSeed;

float signed16(float value) { return value > 32767.5 ? value - 65536.0 : value; }

void makeLump() {
  float id = place.w;
  lumpSeed = fract(sin(vec3(id, id + 7.3, id + 31.7) * vec3(0.7193, 0.4391, 0.9137)) * 4375.85);
  float diameter = mod(motion.w, 256.0) * ${DIAMETER_UNIT.toFixed(4)} * ${DRAWN_SIZE.toFixed(3)};
  lumpSoil = floor(motion.w / 256.0);
  vec3 centre = cloudOrigin + cloudScale * place.xyz;
  centre += ahead * 0.001 * vec3(signed16(motion.x), signed16(motion.y), signed16(motion.z));
  vec3 stretch = mix(vec3(0.72), vec3(1.22), lumpSeed.yzx);
  vec3 axis = normalize(lumpSeed - 0.5 + vec3(0.001));
  float angle = 6.2832 * lumpSeed.x;
  float c = cos(angle), s = sin(angle);
  vec3 p = position * stretch * (0.5 * diameter * mix(0.82, 1.2, lumpSeed.z));
  lumpPosition = centre + p * c + cross(axis, p) * s + axis * dot(axis, p) * (1.0 - c);
  vec3 n = normalize(normal / stretch);
  lumpNormal = n * c + cross(axis, n) * s + axis * dot(axis, n) * (1.0 - c);
}
`;

export class Particles {
  readonly mesh: Mesh;
  private readonly geometry = new InstancedBufferGeometry();
  private readonly uniforms: { [name: string]: IUniform };
  private buffer: InstancedInterleavedBuffer;
  private bytes: Uint8Array;
  private shown: ParticleState | null = null;
  private shownVersion = -1;

  /** @param soilColors uniform with the linear colours by soil id. */
  constructor(soilColors: IUniform<Vector3[]>, detail: Texture) {
    this.uniforms = {
      cloudOrigin: { value: new Vector3() },
      cloudScale: { value: new Vector3() },
      ahead: { value: 0 },
      soilColors,
      soilDetail: { value: detail },
    };
    this.setDetail(1);
    this.geometry.boundingSphere = new Sphere(new Vector3(), Infinity);
    this.geometry.instanceCount = 0;
    [this.buffer, this.bytes] = this.allocate(4096);
    this.mesh = new Mesh(this.geometry, this.material());
    this.mesh.customDepthMaterial = this.depthMaterial();
    this.mesh.frustumCulled = false;
    this.mesh.castShadow = this.mesh.receiveShadow = true;
  }

  /** Set the subdivisions of the faces of a lump. */
  setDetail(detail: 0 | 1): void {
    const lump = lumpGeometry(detail);
    this.geometry.dispose(); // three makes its buffers again
    this.geometry.setAttribute("position", lump.getAttribute("position"));
    this.geometry.setAttribute("normal", lump.getAttribute("normal"));
  }

  /** Take new particles over, and move all by their velocity. */
  update(world: WorldState, now: number): void {
    const particles = world.particles;
    if (particles !== this.shown || (particles?.version ?? -1) !== this.shownVersion) this.take(particles);
    const isMoving = particles && world.frame && !world.frame.paused;
    const age = isMoving ? ((now - particles.receivedAt) / 1000) * Math.min(world.frame?.rtf ?? 1, 2) : 0;
    this.uniforms["ahead"]!.value = Math.min(age, MAX_EXTRAPOLATION);
  }

  private take(particles: ParticleState | null): void {
    this.shown = particles;
    this.shownVersion = particles?.version ?? -1;
    const count = particles?.count ?? 0;
    this.geometry.instanceCount = count;
    this.mesh.visible = count > 0;
    if (!particles || count === 0) return;
    const length = count * PARTICLE_BYTES;
    if (length > this.bytes.length) [this.buffer, this.bytes] = this.allocate(2 * count);
    this.bytes.set(particles.data.length === length ? particles.data : particles.data.subarray(0, length));
    this.buffer.clearUpdateRanges();
    this.buffer.addUpdateRange(0, length / 2);
    this.buffer.needsUpdate = true;
    (this.uniforms["cloudOrigin"]!.value as Vector3).set(...particles.origin);
    (this.uniforms["cloudScale"]!.value as Vector3).set(...particles.scale);
  }

  private allocate(count: number): [InstancedInterleavedBuffer, Uint8Array] {
    const words = new Uint16Array((count * PARTICLE_BYTES) / 2);
    const buffer = new InstancedInterleavedBuffer(words, PARTICLE_BYTES / 2);
    buffer.setUsage(DynamicDrawUsage);
    this.geometry.dispose(); // frees the buffers before; three makes them again
    this.geometry.setAttribute("place", new InterleavedBufferAttribute(buffer, 4, 0, false));
    this.geometry.setAttribute("motion", new InterleavedBufferAttribute(buffer, 4, 4, false));
    return [buffer, new Uint8Array(words.buffer)];
  }

  private material(): MeshStandardMaterial {
    const material = new MeshStandardMaterial({ roughness: 0.97, metalness: 0 });
    material.onBeforeCompile = (shader: WebGLProgramParametersWithUniforms) => {
      Object.assign(shader.uniforms, this.uniforms);
      shader.vertexShader = shader.vertexShader
        .replace(
          "#include <common>",
          `#include <common>\n${VERTEX_GLSL}\nvarying vec3 vLump;\nvarying vec4 vLumpSeed;`,
        )
        .replace(
          "#include <beginnormal_vertex>",
          "makeLump();\n  vec3 objectNormal = lumpNormal;\n  vLump = position;\n  vLumpSeed = vec4(lumpSeed, lumpSoil);",
        )
        .replace("#include <begin_vertex>", "vec3 transformed = lumpPosition;");
      shader.fragmentShader = shader.fragmentShader
        .replace(
          "#include <common>",
          `#include <common>
uniform vec3 soilColors[${MAX_SOILS}];
uniform sampler2D soilDetail;
varying vec3 vLump;
varying vec4 vLumpSeed;`,
        )
        .replace(
          "#include <map_fragment>",
          `vec3 soil = soilColors[min(int(vLumpSeed.w + 0.5), ${MAX_SOILS - 1})];
  soil = mix(vec3(dot(soil, vec3(0.3, 0.59, 0.11))), soil, 0.72);
  vec4 grain = texture2D(soilDetail, (vLump.xy + vec2(vLump.z * 0.7, vLump.z * 0.4)) * 0.09 + vLumpSeed.xy);
  float shade = mix(0.66, 1.22, vLumpSeed.y * vLumpSeed.y) * (0.35 + 1.2 * grain.b);
  float dry = smoothstep(0.7, 1.0, vLumpSeed.x);
  diffuseColor.rgb = mix(soil, vec3(dot(soil, vec3(0.3, 0.59, 0.11))) * vec3(1.3, 1.24, 1.12), 0.4 * dry) * shade;`,
        )
        .replace(
          "#include <aomap_fragment>",
          "reflectedLight.indirectDiffuse *= 0.78;\n  reflectedLight.indirectSpecular *= 0.35;",
        );
    };
    return material;
  }

  private depthMaterial(): MeshDepthMaterial {
    const material = new MeshDepthMaterial({ depthPacking: RGBADepthPacking });
    material.onBeforeCompile = (shader: WebGLProgramParametersWithUniforms) => {
      Object.assign(shader.uniforms, this.uniforms);
      shader.vertexShader = shader.vertexShader
        .replace("#include <common>", `#include <common>\n${VERTEX_GLSL}`)
        .replace("#include <begin_vertex>", "makeLump();\n  vec3 transformed = lumpPosition;");
    };
    return material;
  }
}

/** Return a lumpy polyhedron of radius about 1 with flat faces. */
function lumpGeometry(detail: 0 | 1): BufferGeometry {
  const geometry = new IcosahedronGeometry(1, detail);
  const position = geometry.getAttribute("position");
  const vertex = new Vector3();
  for (let i = 0; i < position.count; i++) {
    vertex.fromBufferAttribute(position, i);
    const { x, y, z } = vertex;
    const bump = Math.sin(3.1 * x + 1.7 * y + 0.4) + Math.sin(4.3 * y - 2.2 * z + 1.1) + Math.sin(5.2 * z + 2.9 * x);
    vertex.multiplyScalar(1 + 0.11 * bump);
    position.setXYZ(i, vertex.x, vertex.y, vertex.z);
  }
  geometry.computeVertexNormals(); // not indexed: one normal for each face
  const normal = geometry.getAttribute("normal");
  for (let i = 0; i < position.count; i++) {
    // Edges are worn: between the face's normal and that of a ball.
    vertex.fromBufferAttribute(position, i).normalize().multiplyScalar(0.8);
    vertex.set(vertex.x + normal.getX(i), vertex.y + normal.getY(i), vertex.z + normal.getZ(i)).normalize();
    normal.setXYZ(i, vertex.x, vertex.y, vertex.z);
  }
  const lump = new BufferGeometry();
  lump.setAttribute("position", new Float32BufferAttribute(position.array as Float32Array, 3));
  lump.setAttribute("normal", geometry.getAttribute("normal"));
  return lump;
}
