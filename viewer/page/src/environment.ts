/** Sky, sun, ambient light and haze. */

import {
  BackSide,
  Color,
  DirectionalLight,
  FogExp2,
  HemisphereLight,
  Matrix4,
  Mesh,
  PCFShadowMap,
  PMREMGenerator,
  Scene,
  ShaderMaterial,
  SphereGeometry,
  Vector3,
  type Texture,
  type WebGLRenderer,
} from "three";

/** Direction to the sun. */
export const SUN = new Vector3(-0.42, -0.62, 0.62).normalize();

/** Colour of the haze and of the sky at the horizon. */
const HAZE = new Color(0.79, 0.845, 0.885);

/** Visibility falls to 1/e^2 over 1.4 / density [m]. */
const HAZE_DENSITY = 0.0019;

const SKY_FRAGMENT = /* glsl */ `
uniform vec3 sun;
uniform vec3 haze;
uniform sampler2D noiseMap;
uniform float cloudAmount;
varying vec3 vDirection;

void main() {
  vec3 d = normalize(vDirection);
  float up = max(d.z, 0.0);
  vec3 zenith = vec3(0.075, 0.205, 0.50);
  vec3 middle = vec3(0.25, 0.455, 0.74);
  vec3 color = mix(haze, middle, smoothstep(0.0, 0.22, up));
  color = mix(color, zenith, smoothstep(0.12, 0.85, up));
  float toSun = max(dot(d, sun), 0.0);
  color += vec3(1.0, 0.86, 0.62) * (0.16 * pow(toSun, 6.0) + 0.30 * pow(toSun, 60.0)) * smoothstep(0.0, 0.1, up);
  if (cloudAmount > 0.0 && up > 0.02) {
    vec2 at = d.xy / (d.z + 0.12);
    vec4 wide = texture2D(noiseMap, at * 0.055 + 0.2);
    vec4 fine = texture2D(noiseMap, at * 0.19 + 0.7);
    float density = wide.a * 0.75 + fine.a * 0.32 - 0.02 * wide.b;
    float cover = smoothstep(0.50, 0.78, density) * smoothstep(0.02, 0.22, up) * cloudAmount;
    float lit = 0.80 + 0.22 * smoothstep(0.9, 0.5, density);
    color = mix(color, vec3(1.0, 0.985, 0.96) * lit, cover * 0.82);
  }
  color = mix(color, haze, 1.0 - smoothstep(-0.01, 0.07, d.z));
  color += 4.0 * vec3(1.0, 0.95, 0.85) * smoothstep(0.99962, 0.99985, toSun);
  gl_FragColor = vec4(color, 1.0);
  #include <colorspace_fragment>
}
`;

/** The sky is drawn at the far plane, around the camera. */
const SKY_VERTEX = /* glsl */ `
varying vec3 vDirection;
void main() {
  vDirection = position;
  gl_Position = projectionMatrix * vec4(mat3(modelViewMatrix) * position, 1.0);
  gl_Position.z = gl_Position.w * 0.999999;
}
`;

/** Light that the sky sends without the disk of the sun; brighter than the picture of the sky. */
const LIGHT_FRAGMENT = /* glsl */ `
uniform vec3 sun;
varying vec3 vDirection;
void main() {
  vec3 d = normalize(vDirection);
  vec3 sky = mix(vec3(1.05, 1.12, 1.18), vec3(0.34, 0.56, 0.95), smoothstep(0.0, 0.7, d.z));
  sky += vec3(1.5, 1.3, 1.0) * pow(max(dot(d, sun), 0.0), 8.0);
  vec3 ground = vec3(0.27, 0.235, 0.18);
  gl_FragColor = vec4(mix(ground, sky, smoothstep(-0.08, 0.06, d.z)), 1.0);
}
`;

export class Environment {
  readonly sun = new DirectionalLight(new Color(1, 0.93, 0.82), 3.4);
  private readonly sky: Mesh;
  private readonly skyMaterial: ShaderMaterial;
  private readonly ambient = new HemisphereLight(new Color(0.72, 0.84, 1), new Color(0.42, 0.35, 0.26));
  private skyLight: Texture | null = null;
  private hasSkyLight = true;
  private shadowExtent = 0;
  private shadowSize = 0;
  private readonly toLight = new Matrix4();
  private readonly fromLight = new Matrix4();
  private readonly snapped = new Vector3();

  constructor(
    private readonly renderer: WebGLRenderer,
    private readonly scene: Scene,
    noise: Texture,
  ) {
    this.skyMaterial = new ShaderMaterial({
      vertexShader: SKY_VERTEX,
      fragmentShader: SKY_FRAGMENT,
      uniforms: { sun: { value: SUN }, haze: { value: HAZE }, noiseMap: { value: noise }, cloudAmount: { value: 1 } },
      side: BackSide,
      depthWrite: false,
      toneMapped: false,
    });
    this.sky = new Mesh(new SphereGeometry(10, 32, 24), this.skyMaterial);
    this.sky.frustumCulled = false;
    this.sky.renderOrder = 10; // after all opaque things, where nothing hides it
    scene.add(this.sky);
    scene.fog = new FogExp2(HAZE, HAZE_DENSITY);
    scene.background = null;
    this.ambient.position.set(0, 0, 1);
    scene.add(this.ambient, this.sun, this.sun.target);
    const { shadow } = this.sun;
    shadow.bias = -0.0006;
    shadow.normalBias = 0.02;
    shadow.radius = 1.6;
    shadow.intensity = 1;
    this.toLight.lookAt(SUN, new Vector3(), new Vector3(0, 0, 1)).invert();
    this.fromLight.copy(this.toLight).invert();
  }

  /** Make again what the lost context held. */
  restore(): void {
    this.skyLight = null;
    this.setSkyLight(this.hasSkyLight);
  }

  /** Light with a picture of the sky, which surfaces reflect, or with two colours, which costs less. */
  setSkyLight(isPicture: boolean): void {
    this.hasSkyLight = isPicture;
    if (isPicture) this.skyLight ??= this.renderSkyLight();
    this.scene.environment = isPicture ? this.skyLight : null;
    this.scene.environmentIntensity = 0.9;
    this.ambient.intensity = isPicture ? 0.2 : 1.7;
  }

  private renderSkyLight(): Texture {
    const generator = new PMREMGenerator(this.renderer);
    const scene = new Scene();
    const material = new ShaderMaterial({
      vertexShader: SKY_VERTEX,
      fragmentShader: LIGHT_FRAGMENT,
      uniforms: { sun: { value: SUN } },
      side: BackSide,
      depthWrite: false,
    });
    const mesh = new Mesh(this.sky.geometry, material);
    mesh.frustumCulled = false;
    scene.add(mesh);
    const light = generator.fromScene(scene, 0.02);
    material.dispose();
    generator.dispose();
    return light.texture;
  }

  /** Set the side of the shadow map [texels]; 0 switches shadows off. */
  setShadows(size: number): void {
    this.sun.castShadow = size > 0;
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    if (size === this.shadowSize || size === 0) return;
    this.shadowSize = size;
    this.sun.shadow.mapSize.set(size, size);
    this.sun.shadow.map?.dispose();
    this.sun.shadow.map = null;
  }

  /**
   * Center the shadow map. It moves by whole texels, so that edges of shadows do not flicker.
   *
   * @param extent distance to which shadows reach [m].
   */
  aimShadow(focus: Vector3, extent: number): void {
    const camera = this.sun.shadow.camera;
    if (extent !== this.shadowExtent) {
      this.shadowExtent = extent;
      camera.left = camera.bottom = -extent;
      camera.right = camera.top = extent;
      camera.near = 1;
      camera.far = 160;
      camera.updateProjectionMatrix();
    }
    const texel = (2 * extent) / Math.max(this.shadowSize, 1);
    const at = this.snapped.copy(focus).applyMatrix4(this.toLight);
    at.x = Math.round(at.x / texel) * texel;
    at.y = Math.round(at.y / texel) * texel;
    at.applyMatrix4(this.fromLight);
    this.sun.target.position.copy(at);
    this.sun.position.copy(SUN).multiplyScalar(80).add(at);
    this.sun.target.updateMatrixWorld();
  }
}
