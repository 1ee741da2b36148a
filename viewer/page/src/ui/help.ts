/** Help: how to dig, and which key, stick or finger does what. */

import { CONTROLS, type Control } from "../driving/deflections";
import { keyInscription } from "../driving/key_names";
import { showsBag, type UiContext } from "./context";
import { makeDialog } from "./dialog";
import { make, setShown, setText, type Child } from "./dom";
import { controlWords } from "./joint_words";
import { LeverDiagram, PedalDiagram } from "./lever_diagram";

/** Keys of the page itself. */
const PAGE_KEYS: readonly (readonly [string, string])[] = [
  ["1 – 4", "camera: orbit, cab, from above, bucket"],
  ["O", "show or hide the gauges"],
  ["U", "hide everything but the scene, and show it again"],
  ["?", "this help"],
];

const BAG_KEYS: readonly (readonly [string, string])[] = [
  ["Space", "play or pause"],
  ["← →", "5 s back or forward; with shift 1 s"],
  ["Home End", "to the start or the end"],
  ["− +", "slower or faster"],
];

/** A step of the instructions; a motion in brackets is replaced by it and its keys. */
const DIG_STEPS = [
  ["Take control", "Press the button or any lever key, or touch an on-screen lever. A machine moves only while you hold a key, stick or lever; let go and it stops."],
  ["Reach", "Open the bucket and push the arm out, then lower the boom until the teeth touch the ground.", "bucket dump", "arm out", "boom down"],
  ["Dig", "Pull the arm in and curl the bucket as it fills. If the arm stalls, raise the boom a little: a shallower cut needs less force.", "arm in", "bucket curl in", "boom up"],
  ["Lift", "Curl the bucket fully in and raise the boom clear of the ground.", "bucket curl in", "boom up"],
  ["Swing", "Turn to where the soil shall go. Begin to brake early: the upper carriage is heavy.", "swing left", "swing right"],
  ["Dump", "Push the arm out and open the bucket.", "arm out", "bucket dump"],
] as const;

export class Help {
  private readonly diagrams: (LeverDiagram | PedalDiagram)[];
  private readonly steps = make("ol", { class: "steps" });
  private readonly actionKeys = make("dl", { class: "key-list" });
  private readonly live: HTMLElement;
  private readonly bag: HTMLElement;
  private readonly pattern = make("small", {});
  readonly dialog: HTMLDialogElement;

  constructor(private readonly context: UiContext) {
    this.diagrams = [
      new PedalDiagram(context, "left", "help-pedal-left"),
      new LeverDiagram(context, "left", "Left lever", "help-lever-left"),
      new LeverDiagram(context, "right", "Right lever", "help-lever-right"),
      new PedalDiagram(context, "right", "help-pedal-right"),
    ];
    this.live = make(
      "div",
      {},
      make("h3", {}, "How to dig"),
      this.steps,
      make("h3", {}, "Levers ", this.pattern),
      make("div", { class: "drive-levers help-levers" }, leverPair(this.diagrams.slice(0, 2)), leverPair(this.diagrams.slice(2))),
      this.actionKeys,
      make("h3", {}, "Gamepad and touch"),
      make(
        "p",
        {},
        "Gamepad: the sticks are the two levers; the triggers drive the tracks forward and the shoulder buttons back. " +
          "Start takes control, B (circle) is the emergency stop. Touch: switch on the on-screen levers and use both thumbs; " +
          "each lever springs back when you lift the finger.",
      ),
    );
    this.bag = make("div", {}, make("h3", {}, "Playback"), keyList(BAG_KEYS));
    this.dialog = makeDialog(
      "Help",
      "help-dialog",
      this.live,
      this.bag,
      make("h3", {}, "View"),
      keyList(PAGE_KEYS),
      make("p", { class: "hint" }, "Drag to turn the camera, with the right button or two fingers to move it; wheel or pinch to zoom."),
    );
    this.dialog.classList.add("help");
  }

  open(): void {
    if (this.dialog.open) return;
    this.update();
    this.dialog.showModal();
  }

  /** Show what has become known of the machine, if the help is open. */
  refresh(): void {
    if (this.dialog.open) this.update();
  }

  private update(): void {
    const { app } = this.context;
    const isBag = showsBag(app);
    setShown(this.live, !isBag);
    setShown(this.bag, isBag);
    for (const diagram of this.diagrams) diagram.updateLabels();
    const machine = this.context.machine();
    setText(this.pattern, machine === null ? "" : `${machine.message.pattern.toUpperCase()} pattern`);
    this.steps.replaceChildren(...this.makeSteps());
    this.actionKeys.replaceChildren(...this.makeActionKeys());
  }

  /** Make the steps, each with the motions that the machine has and their keys. */
  private makeSteps(): HTMLElement[] {
    const keys = this.keysByMotion();
    const isExcavator = ["boom down", "arm in", "bucket curl in", "swing left"].every((motion) => keys.has(motion));
    const steps = isExcavator || keys.size === 0 ? DIG_STEPS : DIG_STEPS.slice(0, 1);
    return steps.map(([title, text, ...motions]) => {
      const hints = motions.map((motion) =>
        make("span", { class: "motion" }, ...(keys.has(motion) ? [make("kbd", {}, keys.get(motion) ?? "")] : []), motion),
      );
      return make("li", {}, make("strong", {}, title), make("span", {}, text), make("span", { class: "motions" }, ...hints));
    });
  }

  /** Return the inscription of the key for each motion of the machine. */
  private keysByMotion(): Map<string, string> {
    const found = new Map<string, string>();
    const machine = this.context.machine();
    if (machine === null) return found;
    const layout = this.context.keyboardLayout();
    for (const [name, deflections] of Object.entries(this.context.app.world.hello?.keys ?? {})) {
      const entries = Object.entries(deflections);
      const [control, sign] = entries[0] ?? ["", 0];
      if (entries.length !== 1 || !isControl(control)) continue;
      const words = controlWords(machine.message, control, sign > 0 ? 1 : -1);
      if (words && !found.has(words)) found.set(words, keyInscription(name, layout));
    }
    return found;
  }

  private makeActionKeys(): Child[] & HTMLElement[] {
    const layout = this.context.keyboardLayout();
    const rows: [string, string][] = [["↑ ↓ ← →", "both tracks: forward, back, turn left, turn right"]];
    for (const [name, meaning] of Object.entries(this.context.app.world.hello?.action_keys ?? {})) {
      if (meaning !== "quit") rows.push([keyInscription(name, layout), meaning]);
    }
    return rows.flatMap(keyRow);
  }
}

/** Put the lever and the pedal of one hand beside each other. */
function leverPair(diagrams: readonly (LeverDiagram | PedalDiagram)[]): HTMLElement {
  return make("div", { class: "lever-pair" }, ...diagrams.map((diagram) => diagram.element));
}

function keyList(rows: readonly (readonly [string, string])[]): HTMLElement {
  return make("dl", { class: "key-list" }, ...rows.flatMap(keyRow));
}

function keyRow([key, meaning]: readonly [string, string]): HTMLElement[] {
  return [make("dt", {}, ...key.split(" ").map((each) => (each === "–" ? make("span", {}, "–") : make("kbd", {}, each)))), make("dd", {}, meaning)];
}

function isControl(name: string): name is Control {
  return (CONTROLS as readonly string[]).includes(name);
}
