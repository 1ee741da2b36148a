/** Conditions that must not be overlooked: lost connection, a machine that does not answer, emergency stop. */

import { machineName, type Part, type UiContext } from "./context";
import { make, makeButton, setShown, setText } from "./dom";
import { formatName } from "./format";

/** Age of the state of a machine above which its node counts as silent [s of simulated time]. */
const MAX_STATE_AGE = 1;

export class Banners implements Part {
  private readonly connection = make("div", { class: "banner banner-warning", role: "alert", "data-testid": "banner-connection" });
  private readonly silent = make("div", { class: "banner banner-warning", role: "alert", "data-testid": "banner-silent", hidden: true });
  private readonly ignored = make(
    "div",
    { class: "banner banner-warning", role: "alert", "data-testid": "banner-ignored", hidden: true },
    "The machine ignores the levers since they, or it, stood still for a moment: release all of them once.",
  );
  private readonly stop: HTMLElement;
  private wasDriving = false;
  readonly element: HTMLElement;

  /** @param releaseStop releases the emergency stop. */
  constructor(
    private readonly context: UiContext,
    releaseStop: () => void,
  ) {
    this.stop = make(
      "div",
      { class: "banner banner-danger", role: "alert", "data-testid": "banner-stop", hidden: true },
      make("span", {}, make("strong", {}, "Emergency stop:"), " all motion is stopped."),
      makeButton(
        { testId: "banner-stop-release", label: "Release the emergency stop", title: "Release (X)", onClick: releaseStop },
        "Release",
      ),
    );
    this.connection.hidden = true;
    this.element = make("div", { class: "banners" }, this.connection, this.silent, this.ignored, this.stop);
  }

  /** Receive that the connection was lost while this page drove a machine. */
  lostWhileDriving(): void {
    this.wasDriving = true;
  }

  update(): void {
    const { app, session } = this.context;
    const { status } = app.connection;
    const isStalled = app.connection.isStalled;
    const isLost = status === "waiting" || status === "closed" || (status === "connecting" && app.world.hello !== null);
    setShown(this.connection, isLost || isStalled || (status === "connecting" && app.world.hello === null));
    if (status === "online") this.wasDriving = false;
    if (isLost) {
      const levers = this.wasDriving ? " The levers were released; take control again afterwards." : "";
      setText(this.connection, `Connection lost. Reconnecting…${levers}`);
    } else if (isStalled) {
      const levers = session.isDriving ? " All levers were released." : "";
      setText(this.connection, `Nothing arrives from the server: the picture is old.${levers}`);
    } else {
      setText(this.connection, "Connecting…");
    }
    const isLive = app.world.hello?.source === "live";
    setShown(this.ignored, session.isDriving && this.context.machine()?.gauges.levers_ignored === true);
    this.updateSilent(isLive && status === "online" && !isStalled);
    setShown(this.stop, isLive && session.selectedMachine !== null && this.context.machine()?.gauges.stopped === true);
    const button = this.stop.querySelector("button");
    if (button !== null) setShown(button, app.world.hello?.may_drive === true);
  }

  /** Show that the selected machine has no state of the present time: a killed node is known as gone only later. */
  private updateSilent(isCurrent: boolean): void {
    const machine = this.context.machine();
    const time = this.context.app.world.frame?.time;
    const age = machine === null || machine.frames === 0 || time == null ? 0 : time - machine.time;
    const isSilent = isCurrent && machine !== null && age > MAX_STATE_AGE;
    setShown(this.silent, isSilent);
    // No number that changes: a screen reader would read each one.
    if (isSilent) setText(this.silent, `${formatName(machineName(machine))} does not answer: what is shown of it is old.`);
  }
}
