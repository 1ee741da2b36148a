/** Tufts of grass on undisturbed ground near the camera. They vanish where the ground is dug, filled or driven flat. */

import {
  BufferGeometry,
  Float32BufferAttribute,
  InstancedBufferAttribute,
  InstancedBufferGeometry,
  DoubleSide,
  Mesh,
  MeshStandardMaterial,
  Sphere,
  Vector2,
  Vector3,
  type IUniform,
  type WebGLProgramParametersWithUniforms,
} from "three";
import { GRASS_COVER_GLSL } from "./grass_cover";
import { HEIGHT_GLSL } from "./height_glsl";
import type { TerrainUniforms } from "./terrain_material";

const BLADES = 6;

/** Tufts for each square metre. */
const DENSITY = 11;

const MAX_TUFTS = 60000;

/** The field is a square that repeats; the camera is always in the middle of one. */
const VERTEX_GLSL = /* glsl */ `
${HEIGHT_GLSL}
uniform sampler2D soilDetail;
uniform sampler2D grassDetail;
uniform sampler2D surfaceMap;
uniform sampler2D shapeMap;
uniform vec2 fieldMiddle;
uniform float fieldSide;
${GRASS_COVER_GLSL}
attribute vec4 tuft; // position in the field, 0 to 1; two random numbers
varying vec3 vTuft;  // height along the blade, greenness, shade

vec3 tuftPosition() {
  vec2 root = tuft.xy * fieldSide;
  root += fieldSide * round((fieldMiddle - root) / fieldSide);
  Cover cover = grassCover(root);
  vec2 at = (gridPosition(root) + 0.5) / grid.yx;
  float outside = outsideDistance(root);
  vec4 surface = textureLod(surfaceMap, at, 0.0);
  vec4 shape = textureLod(shapeMap, at, 0.0);
  float fromMiddle = length(root - fieldMiddle) / (0.5 * fieldSide);
  float grows = smoothstep(0.50, 0.68, cover.patches + cover.worn + 0.25 * (tuft.z - 0.5) + 0.07);
  grows *= 1.0 - step(0.02, surface.a) * step(outside, 0.3);
  grows *= 1.0 - smoothstep(0.25, 0.5, length(shape.xy) * step(outside, 0.0));
  float size = (0.45 + 0.75 * tuft.w) * grows * (1.0 - smoothstep(0.55, 1.0, fromMiddle));
  vTuft = vec3(position.z, smoothstep(0.52, 0.85, cover.patches + 0.2 * (tuft.w - 0.5)), 0.75 + 0.5 * tuft.z);
  if (size < 0.15) return vec3(0.0, 0.0, -1000.0);
  float angle = 6.2832 * (tuft.z * 7.0 + tuft.w);
  mat2 turn = mat2(cos(angle), sin(angle), -sin(angle), cos(angle));
  return vec3(root + turn * position.xy * size, coarseHeight(root) - 0.01 + position.z * size * mix(0.7, 1.3, tuft.z));
}
`;

export class Tufts {
  readonly mesh: Mesh;
  private readonly geometry = new InstancedBufferGeometry();
  private readonly uniforms: { fieldMiddle: IUniform<Vector2>; fieldSide: IUniform<number> } = {
    fieldMiddle: { value: new Vector2() },
    fieldSide: { value: 20 },
  };

  constructor(terrain: TerrainUniforms) {
    const blade = bladesGeometry();
    this.geometry.setAttribute("position", blade.getAttribute("position"));
    this.geometry.setAttribute("normal", blade.getAttribute("normal"));
    const tufts = new Float32Array(4 * MAX_TUFTS);
    for (let i = 0; i < tufts.length; i++) tufts[i] = Math.random();
    this.geometry.setAttribute("tuft", new InstancedBufferAttribute(tufts, 4));
    this.geometry.boundingSphere = new Sphere(new Vector3(), Infinity);
    const material = new MeshStandardMaterial({ roughness: 0.95, side: DoubleSide });
    material.onBeforeCompile = (shader: WebGLProgramParametersWithUniforms) => {
      Object.assign(shader.uniforms, terrain, this.uniforms);
      shader.vertexShader = shader.vertexShader
        .replace("#include <common>", `#include <common>\n${VERTEX_GLSL}`)
        .replace("#include <begin_vertex>", "vec3 transformed = tuftPosition();");
      shader.fragmentShader = shader.fragmentShader
        .replace("#include <common>", "#include <common>\nvarying vec3 vTuft;")
        .replace(
          "#include <map_fragment>",
          `vec3 straw = vec3(0.40, 0.33, 0.185);
  vec3 green = vec3(0.165, 0.185, 0.065);
  diffuseColor.rgb = mix(straw, green, vTuft.y) * vTuft.z * mix(0.5, 1.15, vTuft.x * 7.0);`,
        )
        // Lit from both sides, as the ground is.
        .replace("#include <normal_fragment_begin>", "vec3 normal = normalize(vNormal);\n  vec3 nonPerturbedNormal = normal;");
    };
    this.mesh = new Mesh(this.geometry, material);
    this.mesh.frustumCulled = false;
    this.mesh.receiveShadow = true;
    this.setReach(0);
  }

  /** Set the distance to which tufts grow [m]; 0 for none. */
  setReach(reach: number): void {
    this.mesh.visible = reach > 0;
    this.uniforms.fieldSide.value = 2 * reach;
    this.geometry.instanceCount = Math.min(Math.round(DENSITY * 4 * reach * reach), MAX_TUFTS);
  }

  /** Let the tufts grow around a point. */
  update(eye: Vector3, focus: Vector3): void {
    // Between the camera and what it looks at, as far as the field reaches.
    const side = this.uniforms.fieldSide.value;
    const distance = Math.hypot(focus.x - eye.x, focus.y - eye.y);
    const share = Math.min(1, (0.3 * side) / Math.max(distance, 1e-3));
    this.uniforms.fieldMiddle.value.set(eye.x + share * (focus.x - eye.x), eye.y + share * (focus.y - eye.y));
  }
}

/** Return some thin blades that lean outward, about 0.12 m high; normals point up, so that they are lit as the ground. */
function bladesGeometry(): BufferGeometry {
  const positions: number[] = [];
  const normals: number[] = [];
  for (let i = 0; i < BLADES; i++) {
    const angle = (2 * Math.PI * i) / BLADES + 0.5 * Math.sin(5 * i);
    const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
    const lean = 0.03 + 0.06 * ((i * 0.618) % 1);
    const height = 0.08 + 0.07 * ((i * 0.382) % 1);
    const root = 0.025;
    const half = 0.006;
    positions.push(cos * root - sin * half, sin * root + cos * half, 0);
    positions.push(cos * root + sin * half, sin * root - cos * half, 0);
    positions.push(cos * (root + lean), sin * (root + lean), height);
    for (let k = 0; k < 3; k++) normals.push(0.25 * cos, 0.25 * sin, 0.97);
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new Float32BufferAttribute(positions, 3));
  geometry.setAttribute("normal", new Float32BufferAttribute(normals, 3));
  return geometry;
}
