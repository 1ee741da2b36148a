/** Wooden stakes with painted tops along the border of the map, beyond which nothing is simulated. */

import {
  BoxGeometry,
  BufferAttribute,
  Color,
  InstancedMesh,
  Matrix4,
  MeshDepthMaterial,
  MeshStandardMaterial,
  RGBADepthPacking,
  type Material,
  type WebGLProgramParametersWithUniforms,
} from "three";
import { mergeGeometries } from "three/addons/utils/BufferGeometryUtils.js";
import { HEIGHT_GLSL, type HeightUniforms } from "./height_glsl";

/** Distance of the stakes, about [m]. */
const SPACING = 5;

const MAX_STAKES = 400;

export class BorderStakes {
  readonly mesh: InstancedMesh;

  constructor(height: HeightUniforms) {
    const post = box(0.045, 0.045, 0.85, 0.225, new Color(0.5, 0.36, 0.2));
    const top = box(0.05, 0.05, 0.16, 0.6, new Color(0.9, 0.16, 0.02));
    const material = new MeshStandardMaterial({ vertexColors: true, roughness: 0.8 });
    onGround(material, height);
    this.mesh = new InstancedMesh(mergeGeometries([post, top]), material, MAX_STAKES);
    const depth = new MeshDepthMaterial({ depthPacking: RGBADepthPacking });
    onGround(depth, height);
    this.mesh.customDepthMaterial = depth;
    this.mesh.frustumCulled = false;
    this.mesh.castShadow = true;
    this.mesh.count = 0;
  }

  /** Place the stakes around a map of `sizeX` by `sizeY` [m]. */
  place(sizeX: number, sizeY: number): void {
    let count = 0;
    const matrix = new Matrix4();
    const put = (x: number, y: number): void => {
      if (count < MAX_STAKES) this.mesh.setMatrixAt(count++, matrix.makeRotationZ(1.7 * count).setPosition(x, y, 0));
    };
    const numX = Math.max(Math.round(sizeX / SPACING), 1);
    const numY = Math.max(Math.round(sizeY / SPACING), 1);
    for (let i = 0; i <= numX; i++) for (const y of [-0.5, 0.5]) put((i / numX - 0.5) * sizeX, y * sizeY);
    for (let i = 1; i < numY; i++) for (const x of [-0.5, 0.5]) put(x * sizeX, (i / numY - 0.5) * sizeY);
    this.mesh.count = count;
    this.mesh.instanceMatrix.needsUpdate = true;
  }
}

function box(x: number, y: number, z: number, middle: number, color: Color): BoxGeometry {
  const geometry = new BoxGeometry(x, y, z).translate(0, 0, middle);
  const count = geometry.getAttribute("position").count;
  const colors = new Float32Array(3 * count);
  for (let i = 0; i < count; i++) color.toArray(colors, 3 * i);
  geometry.setAttribute("color", new BufferAttribute(colors, 3));
  return geometry;
}

/** Lift each instance onto the ground. */
function onGround(material: Material, height: HeightUniforms): void {
  material.onBeforeCompile = (shader: WebGLProgramParametersWithUniforms) => {
    Object.assign(shader.uniforms, height);
    shader.vertexShader = shader.vertexShader
      .replace("#include <common>", `#include <common>\n${HEIGHT_GLSL}`)
      .replace(
        "#include <begin_vertex>",
        "vec3 transformed = position + vec3(0.0, 0.0, bilinearHeight(clamp(instanceMatrix[3].xy, -halfSize, halfSize)));",
      );
  };
}
