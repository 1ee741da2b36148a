/** The button of the emergency stop, and its release. */

import { StopEdge } from "../driving/stop_edge";
import type { Part, UiContext } from "./context";
import { make, makeButton, setAttribute, setShown } from "./dom";

/** Time in which the machine must report the stop before the user is told [ms]. */
const CONFIRMATION_MS = 1500;

export class EmergencyStop implements Part {
  private readonly button: HTMLButtonElement;
  private readonly releaseButton: HTMLButtonElement;
  private readonly edge = new StopEdge();
  private isAwaited = false;
  private timer: ReturnType<typeof setTimeout> | undefined;
  readonly element: HTMLElement;

  /** @param releaseLevers releases all levers, whatever holds them. */
  constructor(
    private readonly context: UiContext,
    private readonly releaseLevers: () => void,
  ) {
    this.button = makeButton(
      {
        testId: "emergency-stop",
        label: "Emergency stop",
        title: "Emergency stop (space bar)",
        class: "stop-button",
        onClick: () => this.press(),
      },
      make("span", {}, "STOP"),
    );
    this.releaseButton = makeButton(
      {
        testId: "emergency-stop-release",
        label: "Release the emergency stop",
        title: "Release the emergency stop (X)",
        class: "button stop-release",
        onClick: () => this.release(),
      },
      "Release stop",
    );
    this.element = make("div", { class: "stop", "data-testid": "stop" }, this.releaseButton, this.button);
  }

  /** Whether the machine reports a pressed stop; null if it reports nothing. */
  get isPressed(): boolean | null {
    return this.context.machine()?.gauges.stopped ?? null;
  }

  /** Whether a press was published that the machine has not reported yet. */
  get isRequested(): boolean {
    return this.context.machine()?.gauges.stop_requested === true;
  }

  press(): void {
    const { app, session, toasts } = this.context;
    if (app.world.hello?.source !== "live") return;
    this.releaseLevers();
    if (session.selectedMachine === null && app.connection.status === "online") {
      toasts.show("There is no machine: the emergency stop was NOT sent.", "error");
      return;
    }
    if (app.connection.status !== "online") {
      toasts.show("Not connected: the emergency stop was NOT sent. The levers have been released.", "error");
      return;
    }
    session.setEmergencyStop(true);
    if (this.isPressed === true) return;
    this.isAwaited = true;
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      if (this.isAwaited) toasts.show("The machine has not confirmed the emergency stop.", "error");
      this.isAwaited = false;
    }, CONFIRMATION_MS);
    this.update();
  }

  release(): void {
    if (this.context.app.world.hello?.may_drive !== true) return;
    if (this.isPressed === false && !this.isRequested) return;
    this.context.session.setEmergencyStop(false);
  }

  update(): void {
    const { app, session } = this.context;
    const { hello } = app.world;
    setShown(this.element, hello?.source === "live" && session.selectedMachine !== null);
    const isPressed = this.isPressed === true;
    // Whoever has pressed it: what is held now must not count when someone else releases the stop.
    if (this.edge.update(session.selectedMachine, isPressed || this.isRequested)) this.releaseLevers();
    if (isPressed) this.isAwaited = false;
    setAttribute(this.button, "data-state", isPressed ? "pressed" : this.isAwaited || this.isRequested ? "awaited" : "ready");
    setAttribute(this.button, "aria-pressed", String(isPressed));
    setShown(this.releaseButton, (isPressed || this.isRequested) && hello?.may_drive === true);
  }
}
