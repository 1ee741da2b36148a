/** Shapes of links: primitives of the URDF and embedded glTF. */

import {
  Color,
  CylinderGeometry,
  Group,
  Mesh,
  MeshStandardMaterial,
  SphereGeometry,
  SRGBColorSpace,
  type BufferGeometry,
  type Material,
  type Object3D,
} from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { RoundedBoxGeometry } from "three/addons/geometries/RoundedBoxGeometry.js";
import type { Origin, Rgba, Visual } from "../protocol";

const loader = new GLTFLoader();

/** Meshes that are being decoded. */
const pending = new Set<Promise<void>>();

/** Wait until the meshes of all machines are decoded. */
export async function meshesDecoded(): Promise<void> {
  while (pending.size > 0) await Promise.all(pending);
}

/** Place an object as an `<origin>` of URDF does: roll, pitch, yaw about fixed axes. */
export function placeAt(object: Object3D, origin: Origin): void {
  object.position.set(...origin.xyz);
  const [roll, pitch, yaw] = origin.rpy;
  object.rotation.set(roll, pitch, yaw, "ZYX");
}

/** Return the object of a visual. That of a mesh is empty until it has been decoded. */
export function visualObject(visual: Visual): Object3D {
  const group = new Group();
  placeAt(group, visual.origin);
  if (visual.kind === "mesh") {
    if (visual.glb) {
      const decoding = addMesh(group, visual.glb).finally(() => pending.delete(decoding));
      pending.add(decoding);
    }
  } else {
    const mesh = primitive(visual);
    if (mesh) group.add(mesh);
  }
  return group;
}

export function paint(color: Rgba, roughness = 0.5, metalness = 0): MeshStandardMaterial {
  const [r, g, b, opacity] = color;
  return new MeshStandardMaterial({
    color: new Color().setRGB(r, g, b, SRGBColorSpace),
    roughness,
    metalness,
    transparent: opacity < 1,
    opacity,
  });
}

function primitive(visual: Visual): Mesh | null {
  let mesh: Mesh | null = null;
  if (visual.kind === "box" && visual.size) {
    const [x, y, z] = visual.size;
    const radius = Math.min(0.06, 0.2 * Math.min(x, y, z));
    mesh = new Mesh(new RoundedBoxGeometry(x, y, z, 2, radius), paint(visual.color));
  } else if (visual.kind === "cylinder" && visual.radius && visual.length) {
    const geometry = new CylinderGeometry(visual.radius, visual.radius, visual.length, 32).rotateX(Math.PI / 2);
    mesh = new Mesh(geometry, paint(visual.color));
  } else if (visual.kind === "sphere" && visual.radius) {
    mesh = new Mesh(new SphereGeometry(visual.radius, 24, 16), paint(visual.color));
  }
  if (mesh) mesh.castShadow = mesh.receiveShadow = true;
  return mesh;
}

/** Call `handler` with the geometries and materials of a binary glTF once it is decoded, z up. */
export function decodeParts(glb: Uint8Array, handler: (parts: Mesh<BufferGeometry, Material>[]) => void): void {
  const parse = async (): Promise<void> => {
    const { scene } = await loader.parseAsync(glb.slice().buffer, "");
    const parts: Mesh<BufferGeometry, Material>[] = [];
    scene.rotation.x = Math.PI / 2; // glTF has y up
    scene.updateMatrixWorld(true);
    scene.traverse((object) => {
      if (!(object instanceof Mesh)) return;
      const part = object as Mesh<BufferGeometry, Material>;
      part.geometry.applyMatrix4(part.matrixWorld);
      parts.push(part);
    });
    handler(parts);
  };
  const decoding = parse().finally(() => pending.delete(decoding));
  pending.add(decoding);
}

async function addMesh(group: Group, glb: Uint8Array): Promise<void> {
  const gltf = await loader.parseAsync(glb.slice().buffer, "");
  gltf.scene.rotation.x = Math.PI / 2; // glTF has y up
  gltf.scene.traverse((object) => {
    if (!(object instanceof Mesh)) return;
    const material = object.material as Material;
    const isGlass = material.transparent;
    object.castShadow = !isGlass;
    object.receiveShadow = true;
    if (isGlass) {
      material.depthWrite = false;
      object.renderOrder = 20; // after the sky
    }
    if (material instanceof MeshStandardMaterial && material.metalness > 0.3) material.envMapIntensity = 1.7;
  });
  group.add(gltf.scene);
  gltf.scene.updateMatrixWorld(true);
}

/** Free the GPU's copies of everything below an object. */
export function disposeTree(root: Object3D): void {
  root.traverse((object) => {
    if (!(object instanceof Mesh)) return;
    object.geometry.dispose();
    for (const material of [object.material].flat() as Material[]) material.dispose();
  });
}
