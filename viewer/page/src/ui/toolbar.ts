/** Tools: cameras, view, simulation, recording, bags, help. */

import type { BagsMessage, RecordingMessage } from "../protocol";
import { machineName, showsBag, type Part, type UiContext } from "./context";
import { askConfirmation } from "./dialog";
import { make, makeButton, setAttribute, setShown, setText } from "./dom";
import { formatBytes, formatName } from "./format";
import { makeIcon } from "./icons";
import type { CameraName } from "./interfaces";
import { ChoiceList, Menu } from "./menu";
import { ViewMenu, type SoundSwitch } from "./view_menu";

const CAMERA_TITLES: Record<CameraName, string> = {
  orbit: "Orbit the machine",
  cab: "From the cab",
  top: "From above",
  bucket: "At the bucket",
};

/** Actions of the toolbar that are not its own. */
export interface ToolbarActions {
  openHelp(): void;
  openSource(source: "live" | { bag: string }): void;
  selectMachine(id: string): void;
  /** The colouring was changed. */
  coloringChanged(): void;
  sound: SoundSwitch;
}

export class Toolbar implements Part {
  private readonly cameras = new Map<CameraName, HTMLButtonElement>();
  private readonly view: ViewMenu;
  private readonly machines: Menu;
  private machineChoices: ChoiceList | null = null;
  private machineIds = "";
  private readonly simulation: SimulationTools;
  private readonly record: HTMLButtonElement;
  private readonly recordLabel = make("span", { class: "tool-label", "data-testid": "record-state" });
  private recording: RecordingMessage | null = null;
  private readonly bags: Menu;
  private readonly bagList = make("ul", { class: "bag-list", "data-testid": "bag-list" });
  readonly element: HTMLElement;

  constructor(
    private readonly context: UiContext,
    private readonly actions: ToolbarActions,
  ) {
    const { app } = context;
    const cameras = make("div", { class: "segments", role: "group", "aria-label": "Camera" });
    app.view.cameras.forEach((name, i) => {
      const button = makeButton(
        {
          testId: `camera-${name}`,
          label: `Camera: ${CAMERA_TITLES[name]}`,
          title: `${CAMERA_TITLES[name]} (${i + 1})`,
          class: "tool",
          onClick: () => this.selectCamera(name),
        },
        makeIcon(name),
        make("span", { class: "tool-label" }, formatName(name)),
      );
      this.cameras.set(name, button);
      cameras.append(button);
    });
    this.view = new ViewMenu(context, actions.sound, actions.coloringChanged);
    this.machines = new Menu({ testId: "machine-menu", label: "Machine", icon: "machine" });
    this.simulation = new SimulationTools(context);
    this.record = makeButton(
      { testId: "record", label: "Record", class: "tool", onClick: () => this.toggleRecording() },
      makeIcon("record"),
      this.recordLabel,
    );
    this.bags = new Menu(
      { testId: "bags", label: "Bags", icon: "bags", onOpen: () => app.connection.send({ type: "list_bags" }) },
      this.bagList,
    );
    const help = makeButton(
      { testId: "help", label: "Help", title: "Help (?)", class: "tool", onClick: () => actions.openHelp() },
      makeIcon("help"),
      make("span", { class: "tool-label" }, "Help"),
    );
    this.element = make(
      "nav",
      { class: "panel toolbar", "data-testid": "toolbar", "aria-label": "Tools" },
      cameras,
      this.machines.element,
      this.view.element,
      this.simulation.element,
      this.record,
      this.bags.element,
      help,
    );
    this.receiveBags({ type: "bags", names: [] });
  }

  selectCamera(name: CameraName): void {
    this.context.app.view.setCamera(name);
    this.update();
  }

  receiveBags(message: BagsMessage): void {
    const entries = message.names.map((bag) => {
      const button = makeButton(
        { testId: `bag-${bag}`, label: `Open the bag ${bag}`, class: "list-button", onClick: () => this.open({ bag }) },
        bag,
      );
      return make("li", {}, button);
    });
    if (entries.length === 0) entries.push(make("li", { class: "hint" }, "There are no bags to open."));
    if (showsBag(this.context.app)) {
      const live = makeButton(
        { testId: "bag-live", label: "Live simulation", class: "list-button", onClick: () => this.open("live") },
        makeIcon("back"),
        "Live simulation",
      );
      entries.unshift(make("li", {}, live));
    }
    this.bagList.replaceChildren(...entries);
  }

  receiveRecording(message: RecordingMessage): void {
    if (message.failure) {
      if (message.failure !== this.recording?.failure) {
        this.context.toasts.show(`The recording has failed: ${message.failure}`, "error");
      }
    } else if (this.recording?.on && !message.on && message.path) {
      this.context.toasts.show(`Recorded ${message.path} (${formatBytes(message.bytes)}).`);
    }
    this.recording = message;
    this.update();
  }

  update(): void {
    const { app } = this.context;
    for (const [name, button] of this.cameras) setAttribute(button, "aria-pressed", String(app.view.camera() === name));
    this.view.update();
    this.updateMachines();
    this.simulation.update();
    const { hello } = app.world;
    const isOn = this.recording?.on === true;
    setShown(this.record, hello?.may_record === true && hello.source === "live");
    setAttribute(this.record, "aria-pressed", String(isOn));
    const label = isOn ? "Stop recording" : "Record";
    setAttribute(this.record, "aria-label", label);
    setAttribute(this.record, "title", isOn ? `${label} ${this.recording?.path ?? ""}` : "Record a bag");
    setText(this.recordLabel, isOn ? formatBytes(this.recording?.bytes ?? 0) : "Record");
  }

  private updateMachines(): void {
    const { app } = this.context;
    const ids = [...app.world.machines.keys()].join("\n");
    setShown(this.machines.element, app.world.machines.size > 1);
    if (ids !== this.machineIds) {
      this.machineIds = ids;
      const choices = [...app.world.machines.values()].map((m) => ({ value: m.id, label: formatName(machineName(m)) }));
      this.machineChoices = new ChoiceList("Machine", "machine-choice", choices, (id) => {
        this.actions.selectMachine(id);
        this.machines.close();
      });
      this.machines.panel.replaceChildren(this.machineChoices.element);
    }
    this.machineChoices?.set(this.context.machine()?.id ?? "");
  }

  private toggleRecording(): void {
    this.context.app.connection.send({ type: "record", on: this.recording?.on !== true });
  }

  private open(source: "live" | { bag: string }): void {
    this.bags.close();
    this.actions.openSource(source);
  }
}

/** Pause, step and reset of the simulation. */
class SimulationTools implements Part {
  private readonly pause: HTMLButtonElement;
  private readonly step: HTMLButtonElement;
  private readonly icons = { pause: makeIcon("pause"), play: makeIcon("play") };
  readonly element = make("div", { class: "segments", role: "group", "aria-label": "Simulation" });

  constructor(private readonly context: UiContext) {
    const send = (action: "pause" | "continue" | "step" | "reset"): void => {
      context.app.connection.send({ type: "simulation", action });
    };
    this.pause = makeButton(
      {
        testId: "sim-pause",
        label: "Pause the simulation",
        class: "tool",
        onClick: () => send(context.app.world.frame?.paused ? "continue" : "pause"),
      },
      this.icons.pause,
    );
    this.step = makeButton(
      { testId: "sim-step", label: "Advance the paused simulation by one tick", class: "tool", onClick: () => send("step") },
      makeIcon("step"),
    );
    const reset = makeButton(
      {
        testId: "sim-reset",
        label: "Reset the simulation",
        class: "tool",
        onClick: () =>
          askConfirmation(
            document.body,
            {
              title: "Reset the simulation?",
              text: "All soil and all machines return to their initial state. Everybody who is connected sees it.",
              action: "Reset",
              testId: "reset-dialog",
            },
            () => send("reset"),
          ),
      },
      makeIcon("reset"),
    );
    this.element.append(this.pause, this.step, reset);
  }

  update(): void {
    const { hello, frame } = this.context.app.world;
    setShown(this.element, hello?.may_control_simulation === true && hello.source === "live");
    const isPaused = frame?.paused === true;
    const icon = isPaused ? this.icons.play : this.icons.pause;
    if (this.pause.firstChild !== icon) this.pause.replaceChildren(icon);
    const label = isPaused ? "Continue the simulation" : "Pause the simulation";
    setAttribute(this.pause, "aria-label", label);
    setAttribute(this.pause, "title", label);
    if (this.step.disabled === isPaused) this.step.disabled = !isPaused;
  }
}
