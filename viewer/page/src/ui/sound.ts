/** The engine sound as a part of the user interface: it follows the selected machine. */

import { EngineSound } from "../effects/engine_sound";
import type { UiContext } from "./context";
import type { SoundSwitch } from "./view_menu";

/** Joint speed of a machine at full lever [rad/s], by which its oil flow is judged. */
const FULL_JOINT_SPEED = 0.6;

export class Sound implements SoundSwitch {
  private readonly engine = new EngineSound();

  constructor(private readonly context: UiContext) {}

  get isOn(): boolean {
    return this.engine.isOn;
  }

  /** Switch the sound; to be called from the handler of a click. */
  setOn(on: boolean): void {
    if (on) this.engine.start();
    else this.engine.stop();
  }

  update(): void {
    if (!this.engine.isOn) return;
    const machine = this.context.machine();
    const { connection, world, view } = this.context.app;
    if (machine === null || connection.status !== "online" || world.frame?.paused !== false) {
      this.engine.update(null);
      return;
    }
    let speed = 0;
    machine.message.model.joints.forEach(({ name }, i) => {
      if (name in machine.message.levers) speed += Math.abs(machine.velocities[i] ?? 0);
    });
    this.engine.update({
      load: machine.load,
      hydraulic_flow: speed / FULL_JOINT_SPEED,
      track_speed: machine.gauges.speed ?? 0,
      distance: view.distanceTo(machine.id),
    });
  }
}
