/** Bar with control of the machine, levers, speed and inputs. */

import { machineName, type Part, type UiContext } from "./context";
import { make, makeButton, setAttribute, setShown, setText } from "./dom";
import { formatName, formatNumber } from "./format";
import { makeIcon } from "./icons";
import { LeverDiagram, PedalDiagram } from "./lever_diagram";
import { Switch } from "./menu";

/** What the bar shows of the gamepad. */
export interface GamepadStatus {
  name: string | null;
  isStandard: boolean;
}

export class DriveBar implements Part {
  private readonly text = make("p", { class: "drive-state", role: "status", "data-testid": "drive-state" });
  private readonly take: HTMLButtonElement;
  private readonly takeOver: HTMLButtonElement;
  private readonly release: HTMLButtonElement;
  private readonly slider = make("input", {
    type: "range",
    min: 10,
    max: 100,
    step: 10,
    "data-testid": "speed",
    "aria-label": "Full deflection of a held key",
    title: "Full deflection of a held key (+ and −)",
  });
  private readonly sliderValue = make("output", { class: "row-value", "data-testid": "speed-value" });
  private readonly gamepad = make("span", { class: "chip", "data-testid": "gamepad" });
  private readonly gamepadName = make("span", {});
  private readonly touch: Switch;
  private readonly levers: readonly (LeverDiagram | PedalDiagram)[];
  private readonly leverRow = make("div", { class: "drive-levers", "data-testid": "lever-diagrams" });
  readonly element: HTMLElement;

  constructor(
    private readonly context: UiContext,
    setTouch: (on: boolean) => void,
  ) {
    const { session } = context;
    this.take = makeButton(
      { testId: "take-control", label: "Take control", class: "button button-primary", onClick: () => session.takeControl() },
      "Take control",
    );
    this.takeOver = makeButton(
      { testId: "take-over", label: "Take over", onClick: () => session.takeControl(true) },
      "Take over",
    );
    this.release = makeButton(
      { testId: "release-control", label: "Release control", onClick: () => session.releaseControl() },
      "Release control",
    );
    this.slider.addEventListener("input", () => session.setSpeed(Number(this.slider.value) / 100));
    this.gamepad.append(makeIcon("gamepad"), this.gamepadName);
    this.touch = new Switch("On-screen levers", "touch-switch", setTouch);
    this.levers = [
      new PedalDiagram(context, "left", "pedal-left"),
      new LeverDiagram(context, "left", "Left lever", "lever-left"),
      new LeverDiagram(context, "right", "Right lever", "lever-right"),
      new PedalDiagram(context, "right", "pedal-right"),
    ];
    this.leverRow.append(...this.levers.map((lever) => lever.element));
    this.element = make(
      "section",
      { class: "panel drive-bar", "data-testid": "drive-bar", "aria-label": "Driving" },
      this.leverRow,
      make(
        "div",
        { class: "drive-row" },
        make("div", { class: "drive-control" }, this.take, this.takeOver, this.release, this.text),
        make(
          "div",
          { class: "drive-options" },
          make("label", { class: "speed" }, make("span", { class: "row-label" }, "Speed"), this.slider, this.sliderValue),
          this.touch.element,
          this.gamepad,
        ),
      ),
    );
  }

  setGamepad({ name, isStandard }: GamepadStatus): void {
    setText(this.gamepadName, name === null ? "" : isStandard ? "Gamepad" : "Gamepad not supported");
    setAttribute(this.gamepad, "title", name ?? undefined);
    setShown(this.gamepad, name !== null);
  }

  setTouch(on: boolean): void {
    this.touch.set(on);
  }

  /** Move the diagrams to the present deflections. */
  moveLevers(): void {
    const deflections = this.context.deflections();
    for (const lever of this.levers) lever.move(deflections);
  }

  update(): void {
    const { app, session } = this.context;
    const { state } = session;
    const { hello } = app.world;
    setShown(this.element, hello?.source === "live" && hello.may_drive);
    const isDriving = state === "driving";
    setAttribute(this.element, "data-state", state);
    setShown(this.take, state === "free" || state === "requested" || state === "unavailable");
    if (this.take.disabled !== (state !== "free")) this.take.disabled = state !== "free";
    setShown(this.takeOver, state === "taken");
    setShown(this.release, isDriving);
    setShown(this.leverRow, isDriving);
    setText(this.text, this.stateText());
    const percent = String(Math.round(100 * session.speed));
    if (this.slider.value !== percent) this.slider.value = percent;
    setText(this.sliderValue, `${formatNumber(100 * session.speed)} %`);
    for (const lever of this.levers) lever.updateLabels();
  }

  private stateText(): string {
    const { session } = this.context;
    const machine = this.context.machine();
    const name = machine === null ? "" : formatName(machineName(machine));
    switch (session.state) {
      case "unavailable":
        return machine === null ? "No machine to drive" : "Not connected";
      case "free":
        return `${name}: nobody drives`;
      case "requested":
        return "Waiting for control…";
      case "driving":
        return `You drive: ${name}`;
      case "taken":
        return `${name}: driven by viewer ${session.driver ?? ""}`;
    }
  }
}
