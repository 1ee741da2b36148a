/** Conditions that must not be overlooked: lost connection, emergency stop. */

import type { Part, UiContext } from "./context";
import { make, makeButton, setShown, setText } from "./dom";

export class Banners implements Part {
  private readonly connection = make("div", { class: "banner banner-warning", role: "alert", "data-testid": "banner-connection" });
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
    this.element = make("div", { class: "banners" }, this.connection, this.stop);
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
    setShown(this.stop, isLive && session.selectedMachine !== null && this.context.machine()?.gauges.stopped === true);
    const button = this.stop.querySelector("button");
    if (button !== null) setShown(button, app.world.hello?.may_drive === true);
  }
}
