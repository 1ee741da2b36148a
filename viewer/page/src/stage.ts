/** The 3-D view: renderer, scene, and what is done for each frame. */

import { NeutralToneMapping, Scene, Vector3, WebGLRenderer } from "three";
import { CameraRig } from "./cameras/camera_rig";
import { clamp } from "./clamp";
import { Dust } from "./effects/dust";
import { Puffs } from "./effects/puffs";
import { Smoke } from "./effects/smoke";
import { Environment } from "./environment";
import type { MachineView } from "./machines/machine_view";
import { Machines } from "./machines/machines";
import { Particles } from "./particles";
import { Quality } from "./quality";
import { Terrain } from "./terrain/terrain";
import type { CameraName, QualityName } from "./ui/interfaces";
import type { WorldState } from "./world_state";

export interface StageOptions {
  /** Null selects automatically. */
  quality: QualityName | null;
  camera: CameraName;
  /** Draw without a graphics card: no smooth edges, and the lowest quality first. */
  isSoftware: boolean;
}

/** Largest number of puffs of smoke and dust. */
const MAX_PUFFS = 640;

/** Distances to which shadows reach [m]; the smallest that suits the camera is used. */
const SHADOW_EXTENTS = [12, 18, 28, 45];

/** Largest distance by which the center of the view is moved, as a fraction of the height of the canvas. */
const MAX_LIFT = 0.25;

/** Longest step of smoke and dust in pictures [s]. */
const EFFECT_STEP = 1 / 30;

export class Stage {
  readonly renderer: WebGLRenderer;
  readonly scene = new Scene();
  readonly cameras: CameraRig;
  readonly quality: Quality;
  readonly terrain: Terrain;
  readonly machines: Machines;
  readonly particles: Particles;
  readonly environment: Environment;
  /** Switches of what is drawn besides ground, particles and machines. */
  readonly effects = { smoke: true, dust: true };
  /** Id of the machine that cameras follow; empty: the first one. */
  followed = "";
  /** Heights of the canvas that panels cover at its edges [px]. */
  covered = { top: 0, bottom: 0 };
  /** Number of frames drawn. */
  frames = 0;
  private lastTime = 0;
  private readonly puffs: Puffs;
  private readonly smoke: Smoke;
  private readonly dust: Dust;
  private readonly shadowFocus = new Vector3();

  constructor(
    readonly canvas: HTMLCanvasElement,
    private readonly world: WorldState,
    options: StageOptions,
  ) {
    const antialias = !options.isSoftware; // without a graphics card it takes most of the time of a frame
    this.renderer = new WebGLRenderer({ canvas, antialias, powerPreference: "high-performance" });
    this.renderer.debug.checkShaderErrors = false; // the check waits for each compilation
    this.renderer.toneMapping = NeutralToneMapping;
    this.renderer.toneMappingExposure = 0.92;
    this.quality = new Quality(options.quality, options.isSoftware ? "low" : "medium");
    this.terrain = new Terrain(this.quality.values.terrain, options.isSoftware);
    this.machines = new Machines(world);
    this.particles = new Particles(this.terrain.uniforms.soilColors, this.terrain.soilDetail);
    this.environment = new Environment(this.renderer, this.scene, this.terrain.grassDetail);
    this.puffs = new Puffs(MAX_PUFFS, this.terrain.grassDetail, this.terrain.heightUniforms);
    this.smoke = new Smoke(this.puffs);
    this.dust = new Dust(this.puffs);
    this.scene.add(this.terrain.group, this.machines.group, this.particles.mesh, this.puffs.mesh);
    this.cameras = new CameraRig(canvas);
    this.cameras.select(options.camera, false);
    this.quality.onChange((level) => {
      this.environment.setShadows(level.shadowSize);
      this.environment.setSkyLight(level.hasSkyLight);
      this.particles.setDetail(level.lumpDetail);
      this.terrain.setDetail(level.terrain);
      this.resize();
    });
    new ResizeObserver(() => this.resize()).observe(canvas);
    // After the first resize, which would wait for them. Both run while the state is on its way.
    this.terrain.upload(this.renderer);
    this.renderer.compile(this.scene, this.cameras.camera);
    document.addEventListener("visibilitychange", () => this.quality.interrupt());
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => this.restore());
  }

  /** The machine that cameras follow. */
  get machine(): MachineView | null {
    const { views } = this.machines;
    const followed = views.get(this.followed);
    if (followed) return followed;
    for (const view of views.values()) return view;
    return null;
  }

  /** Take over the site of the world. */
  siteChanged(): void {
    this.terrain.setSite(this.world.site, this.world.terrain);
  }

  start(): void {
    this.renderer.setAnimationLoop((time) => this.draw(time));
  }

  private draw(time: number): void {
    const elapsed = (time - this.lastTime) / 1000;
    this.lastTime = time;
    const dt = clamp(elapsed, 0, 0.25);
    this.quality.count(elapsed);
    this.machines.update(performance.now(), dt);
    const { frame } = this.world;
    this.updateEffects(frame && !frame.paused ? dt * Math.min(frame.rtf, 2) : 0);
    this.drawFrame(dt);
  }

  /** Move machines to the newest frame without a transition, and smoke and dust by a simulated time [s]. */
  advance(elapsed: number): void {
    this.machines.update(performance.now(), Infinity);
    const steps = Math.max(1, Math.ceil(elapsed / EFFECT_STEP));
    for (let i = 0; i < steps; i++) this.updateEffects(elapsed / steps);
  }

  /** Draw the newest frame; `dt` is the time since the last drawn one [s], for the camera. */
  drawFrame(dt: number): void {
    this.particles.update(this.world, performance.now());
    this.terrain.upload(this.renderer);
    const { camera, focus } = this.cameras;
    const height = Math.max(this.canvas.clientHeight, 1);
    const aspect = this.canvas.clientWidth / height;
    const lift = clamp((0.5 * (this.covered.bottom - this.covered.top)) / height, -MAX_LIFT, MAX_LIFT);
    this.cameras.update({ machine: this.machine, terrain: this.world.terrain, aspect, lift, dt });
    const extent = this.aimShadow();
    this.shadeUnderMachines();
    this.terrain.update(camera, this.cameras.detailEye, focus, 1.5 * extent);
    this.renderer.render(this.scene, camera);
    this.frames++;
  }

  /** Continue smoke and dust by a simulated time [s]. */
  private updateEffects(simulated: number): void {
    if (this.effects.smoke) this.smoke.update(this.machines.views.values(), simulated);
    if (this.effects.dust) this.dust.update(this.world);
    this.puffs.update(simulated);
  }

  /** Center the shadows between the machine and what is looked at; return their reach [m]. */
  private aimShadow(): number {
    const { focus } = this.cameras;
    const distance = this.cameras.detailEye.distanceTo(focus);
    const extent = SHADOW_EXTENTS.find((each) => each > 0.8 * distance) ?? 45;
    this.shadowFocus.copy(focus);
    const machine = this.machine;
    if (machine && machine.basePosition.distanceTo(focus) < 15) this.shadowFocus.lerp(machine.basePosition, 0.5);
    this.environment.aimShadow(this.shadowFocus, extent);
    return extent;
  }

  private shadeUnderMachines(): void {
    let count = 0;
    for (const view of this.machines.views.values()) {
      const track = view.state.message.model.tracks[0];
      if (!track || view.state.frames === 0) continue;
      const { x, y } = view.basePosition;
      const halfLength = 0.5 * track.axle_distance + 0.6 * track.radius;
      this.terrain.setContact(count++, x, y, view.baseYaw, halfLength, Math.abs(track.y) + 0.4 * track.shoe_size[1]);
    }
    this.terrain.setContactCount(count);
  }

  private resize(): void {
    const { clientWidth, clientHeight } = this.canvas;
    if (clientWidth === 0 || clientHeight === 0) return;
    const { values, resolution } = this.quality;
    this.renderer.setPixelRatio(resolution * Math.min(window.devicePixelRatio, values.pixelRatio));
    this.renderer.setSize(clientWidth, clientHeight, false);
  }

  /** Make again what the lost context held. */
  private restore(): void {
    this.terrain.restore(this.world.terrain);
    this.terrain.upload(this.renderer);
    this.environment.restore();
  }
}
