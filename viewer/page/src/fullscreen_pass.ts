/** A pass that runs a fragment shader over (a part of) a render target. */

import {
  BufferAttribute,
  BufferGeometry,
  Camera,
  GLSL3,
  Mesh,
  NoBlending,
  RawShaderMaterial,
  Scene,
  type IUniform,
  type WebGLRenderer,
  type WebGLRenderTarget,
} from "three";

const VERTEX = /* glsl */ `
in vec3 position;
void main() { gl_Position = vec4(position, 1.0); }
`;

/** The fragment shader is GLSL 3 with its own outputs; `gl_FragCoord.xy` is the texel. */
export class FullscreenPass {
  private readonly material: RawShaderMaterial;
  private readonly geometry = new BufferGeometry();
  private readonly scene = new Scene();
  private readonly camera = new Camera();

  constructor(fragment: string, uniforms: { [name: string]: IUniform }) {
    this.material = new RawShaderMaterial({
      glslVersion: GLSL3,
      vertexShader: VERTEX,
      fragmentShader: `precision highp float;\nprecision highp int;\n${fragment}`,
      uniforms,
      depthTest: false,
      depthWrite: false,
      blending: NoBlending,
    });
    this.geometry.setAttribute("position", new BufferAttribute(new Float32Array([-1, -1, 0, 3, -1, 0, -1, 3, 0]), 3));
    const mesh = new Mesh(this.geometry, this.material);
    mesh.frustumCulled = false;
    this.scene.add(mesh);
  }

  /** Render to the target, inside of the target's scissor if that is set. */
  render(renderer: WebGLRenderer, target: WebGLRenderTarget): void {
    const { autoClear, shadowMap } = renderer;
    const previous = renderer.getRenderTarget();
    const autoUpdate = shadowMap.autoUpdate;
    renderer.autoClear = false;
    shadowMap.autoUpdate = false;
    renderer.setRenderTarget(target);
    renderer.render(this.scene, this.camera);
    renderer.setRenderTarget(previous);
    renderer.autoClear = autoClear;
    shadowMap.autoUpdate = autoUpdate;
  }

  dispose(): void {
    this.material.dispose();
    this.geometry.dispose();
  }
}
