/** Materials of the ground: three's standard material and depth material with other vertices and surface. */

import {
  MeshDepthMaterial,
  MeshStandardMaterial,
  RGBADepthPacking,
  Vector2,
  Vector3,
  Vector4,
  type IUniform,
  type Material,
  type WebGLProgramParametersWithUniforms,
} from "three";
import { COLORINGS, scaleTexture } from "./colorings";
import type { DetailTextures } from "./detail_textures";
import { HEIGHT_GLSL, type HeightUniforms } from "./height_glsl";
import { PATCH_GLSL } from "./patches";
import { SURFACE_GLSL } from "./surface_glsl";
import { MAX_SOILS } from "./surface_maps";

/** Largest number of bodies that shade the ground under them. */
export const MAX_CONTACTS = 4;

export interface TerrainUniforms {
  [name: string]: IUniform;
  lodEye: IUniform<Vector4>;
  lodGround: IUniform<number>;
  coloring: IUniform<Vector4>;
  contourStep: IUniform<number>;
  commonSoil: IUniform<number>;
  detailAmount: IUniform<number>;
  contacts: IUniform<Vector4[]>;
  contactAxes: IUniform<Vector2[]>;
  contactCount: IUniform<number>;
  soilColors: IUniform<Vector3[]>;
}

export function terrainUniforms(height: HeightUniforms, detail: DetailTextures): TerrainUniforms {
  return {
    ...height,
    lodEye: { value: new Vector4(0, 0, 0, 10) },
    lodGround: { value: 0 },
    shapeMap: { value: null },
    surfaceMap: { value: null },
    stateMap: { value: null },
    cellMap: { value: null },
    designMap: { value: null },
    soilDetail: { value: detail.soil },
    grassDetail: { value: detail.grass },
    scaleMap: { value: scaleTexture() },
    soilColors: { value: Array.from({ length: MAX_SOILS }, () => new Vector3()) },
    coloring: { value: new Vector4(0, 0, 1, 0) },
    contourStep: { value: 0 },
    commonSoil: { value: 0 },
    detailAmount: { value: 1 },
    contacts: { value: Array.from({ length: MAX_CONTACTS }, () => new Vector4()) },
    contactAxes: { value: Array.from({ length: MAX_CONTACTS }, () => new Vector2(1, 0)) },
    contactCount: { value: 0 },
  };
}

const DEFINES = `
#define MAX_SOILS ${MAX_SOILS}
#define MAX_CONTACTS ${MAX_CONTACTS}
#define COLORING_COUNT ${COLORINGS.length}.0
`;

const VERTEX_POSITION = /* glsl */ `
  vec2 groundXy = patchPosition();
#ifdef PLAIN
  vec3 transformed = vec3(groundXy, coarseHeight(groundXy));
#else
  vec3 transformed = vec3(groundXy, patchData.z > grid.z * 1.5 ? coarseHeight(groundXy) : terrainHeight(groundXy));
#endif
`;

/** Normal of the ground at the spacing of the vertices, for the shadow's offset and for the ground outside. */
const VERTEX_NORMAL = /* glsl */ `
  vec2 normalXy = patchPosition();
  float normalStep = max(patchData.z, grid.z);
  vec3 objectNormal = vec3(0.0, 0.0, 1.0);
#ifdef PLAIN
  bool needsNormal = outsideDistance(normalXy) > 0.0;
#else
  bool needsNormal = true;
#endif
  if (needsNormal) {
    objectNormal = normalize(vec3(
      coarseHeight(normalXy - vec2(normalStep, 0.0)) - coarseHeight(normalXy + vec2(normalStep, 0.0)),
      coarseHeight(normalXy - vec2(0.0, normalStep)) - coarseHeight(normalXy + vec2(0.0, normalStep)),
      2.0 * normalStep));
  }
  vGroundNormal = objectNormal;
`;

export function terrainMaterial(uniforms: TerrainUniforms): MeshStandardMaterial {
  const material = new MeshStandardMaterial({ roughness: 1, metalness: 0 });
  material.onBeforeCompile = (shader: WebGLProgramParametersWithUniforms) => {
    Object.assign(shader.uniforms, uniforms);
    shader.vertexShader = shader.vertexShader
      .replace(
        "#include <common>",
        `#include <common>\n${HEIGHT_GLSL}${PATCH_GLSL}\nvarying vec3 vGround;\nvarying vec3 vGroundNormal;`,
      )
      .replace("#include <beginnormal_vertex>", VERTEX_NORMAL)
      .replace("#include <begin_vertex>", `${VERTEX_POSITION}\n  vGround = transformed;`);
    shader.fragmentShader = shader.fragmentShader
      .replace("#include <common>", `#include <common>\n${DEFINES}${HEIGHT_GLSL}${SURFACE_GLSL}`)
      .replace("#include <map_fragment>", "Ground ground = groundAt();\n  diffuseColor.rgb = ground.color;")
      .replace("#include <roughnessmap_fragment>", "float roughnessFactor = ground.roughness;")
      .replace(
        "#include <normal_fragment_maps>",
        "normal = normalize((viewMatrix * vec4(ground.normal, 0.0)).xyz);\n  nonPerturbedNormal = normal;",
      )
      .replace(
        "#include <aomap_fragment>",
        `reflectedLight.indirectDiffuse *= ground.openness;
  reflectedLight.indirectSpecular *= ground.openness * 0.5;
  reflectedLight.directDiffuse *= mix(1.0, ground.openness, 0.3);`,
      );
  };
  return material;
}

/** Let a material of the ground read few textures, or all that its look needs. */
export function setPlain(material: Material, isPlain: boolean): void {
  const defines = (material.defines ??= {});
  if ("PLAIN" in defines === isPlain) return;
  if (isPlain) defines["PLAIN"] = "";
  else delete defines["PLAIN"];
  material.needsUpdate = true;
}

export function terrainDepthMaterial(uniforms: TerrainUniforms): MeshDepthMaterial {
  const material = new MeshDepthMaterial({ depthPacking: RGBADepthPacking });
  material.onBeforeCompile = (shader: WebGLProgramParametersWithUniforms) => {
    Object.assign(shader.uniforms, uniforms);
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", `#include <common>\n${HEIGHT_GLSL}${PATCH_GLSL}`)
      .replace("#include <begin_vertex>", VERTEX_POSITION);
  };
  return material;
}
