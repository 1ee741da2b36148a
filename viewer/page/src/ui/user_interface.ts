/** Composition of the user interface. */

import { isAtRest, keyDeflections, mergeDeflections, type Deflections } from "../driving/deflections";
import { DRIVE_INTERVAL_MS, DrivingSession } from "../driving/driving_session";
import { Gamepads } from "../driving/gamepads";
import { Keyboard } from "../driving/keyboard";
import { MachineSelection } from "../driving/machine_selection";
import type { ControlMessage } from "../protocol";
import type { MachineState } from "../world_state";
import { Banners } from "./banners";
import { machineName, showsBag, type Part, type UiContext } from "./context";
import { watchCovered } from "./covered";
import { isDialogOpen } from "./dialog";
import { make, setAttribute } from "./dom";
import { DriveBar } from "./drive_bar";
import { EmergencyStop } from "./emergency_stop";
import { formatName, sentence } from "./format";
import { Help } from "./help";
import type { App } from "./interfaces";
import { Legend } from "./legend";
import { Login } from "./login";
import { Overlay } from "./overlay";
import { readSetting, writeSetting } from "./settings";
import { Sound } from "./sound";
import { Timeline } from "./timeline";
import { Toasts } from "./toasts";
import { Toolbar } from "./toolbar";
import { TouchPanels } from "./touch_panels";

/** Interval of the updates of numbers [ms]. */
const UPDATE_INTERVAL_MS = 100;

/** Time after a take-over in which refused drive messages need no explanation of their own [ms]. */
const TAKE_OVER_MS = 1500;

/** Time after which a machine counts as gone [ms]: after a lost connection the machines arrive one by one. */
const REPLACEMENT_MS = 1000;

/** What the rest of the page reads of the user interface. */
export interface UserInterface {
  /** Machine that is shown and driven; null before the first. */
  readonly selectedMachine: string | null;
  readonly isDriving: boolean;
}

export function createUserInterface(app: App): UserInterface {
  return new Composition(app);
}

class Composition implements UserInterface, UiContext {
  readonly toasts = new Toasts();
  readonly session: DrivingSession;
  private readonly overlay: Overlay;
  private readonly toolbar: Toolbar;
  private readonly legend: Legend;
  private readonly banners: Banners;
  private readonly stop: EmergencyStop;
  private readonly driveBar: DriveBar;
  private readonly touch: TouchPanels;
  private readonly timeline: Timeline;
  private readonly help: Help;
  private readonly login: Login;
  private readonly sound: Sound;
  private readonly parts: readonly Part[];
  private readonly keyboard: Keyboard | undefined;
  private layout: ReadonlyMap<string, string> | null = null;
  private lostControlAt = -Infinity;
  private readonly selection = new MachineSelection();
  /** Time [ms] since which another machine is selected than the user saw. */
  private replacedAt: number | null = null;
  /** Source whose machines are selected from. */
  private shownSource = "";

  constructor(readonly app: App) {
    this.session = new DrivingSession(
      (message) => void app.connection.send(message),
      () => this.drivingChanged(),
      (call, delay) => void setTimeout(call, delay),
      () => performance.now(),
    );
    this.sound = new Sound(this);
    this.overlay = new Overlay(this);
    this.legend = new Legend(this);
    this.stop = new EmergencyStop(this, () => this.releaseInputs());
    this.banners = new Banners(this, () => this.stop.release());
    this.driveBar = new DriveBar(this, (on) => this.setTouch(on));
    this.touch = new TouchPanels(this, (deflections) => this.session.setTouchDeflections(deflections));
    this.timeline = new Timeline(this);
    this.help = new Help(this);
    this.login = new Login(this, () => this.openSource("live"));
    this.toolbar = new Toolbar(this, {
      openHelp: () => this.openHelp(),
      openSource: (source) => this.openSource(source),
      selectMachine: (id) => this.chooseMachine(id),
      coloringChanged: () => this.legend.refresh(),
      sound: this.sound,
    });
    this.parts = [this.overlay, this.toolbar, this.legend, this.banners, this.stop, this.driveBar, this.touch, this.timeline];
    this.arrange();
    this.setTouch((readSetting("touch") ?? String(matchMedia("(pointer: coarse)").matches)) === "true");

    this.keyboard = new Keyboard(window, {
      isLever: (name) => this.isLever(name),
      heldChanged: (held) => this.heldChanged(held),
      pressed: (name, event) => this.pressed(name, event),
      focusLost: () => this.focusLost(),
    });
    new Gamepads(window, {
      isBlocked: () => isDialogOpen() || this.login.isOpen || this.app.connection.isStalled,
      deflected: (deflections) => this.session.setDeflections("gamepad", deflections),
      stopPressed: () => this.stop.press(),
      startPressed: () => this.session.takeControl(),
      connectionChanged: (name, isStandard) => this.driveBar.setGamepad({ name, isStandard }),
    });
    this.subscribe();
    void this.readLayout();
    setInterval(() => this.session.tick(), DRIVE_INTERVAL_MS);
    setInterval(() => {
      this.checkSilence();
      this.checkReplacement();
      this.update();
    }, UPDATE_INTERVAL_MS);
  }

  get selectedMachine(): string | null {
    return this.session.selectedMachine;
  }

  get isDriving(): boolean {
    return this.session.isDriving;
  }

  machine(): MachineState | null {
    const id = this.session.selectedMachine;
    return id === null ? null : (this.app.world.machines.get(id) ?? null);
  }

  deflections(): Deflections {
    const keys = this.app.world.hello?.keys ?? {};
    const { heldKeys, speed, deflections } = this.session;
    return mergeDeflections(keyDeflections(heldKeys, keys, speed), deflections);
  }

  keyboardLayout(): ReadonlyMap<string, string> | null {
    return this.layout;
  }

  /** Put the parts into the page. */
  private arrange(): void {
    const right = make("div", { class: "area-right" }, this.toolbar.element, this.legend.element);
    const center = make("div", { class: "area-center" }, this.banners.element, this.toasts.element);
    const bottom = make(
      "div",
      { class: "area-bottom" },
      this.touch.left,
      make("div", { class: "area-drive" }, this.driveBar.element, this.timeline.element),
      this.touch.right,
      this.stop.element,
    );
    const { root } = this.app;
    root.classList.add("ui");
    root.replaceChildren(this.overlay.element, center, right, bottom, this.login.element, this.help.dialog);
    watchCovered([this.toolbar.element, this.overlay.element], bottom, (above, below) =>
      this.app.view.setCovered(above, below),
    );
    // An input that was set with the pointer gives the keys back to the levers.
    let isPointer = false;
    root.addEventListener("pointerdown", () => (isPointer = true), { capture: true });
    root.addEventListener("keydown", () => (isPointer = false), { capture: true });
    root.addEventListener("change", ({ target }) => {
      if (isPointer && target instanceof HTMLInputElement && target.type !== "password") target.blur();
    });
  }

  private subscribe(): void {
    const { connection, world } = this.app;
    connection.on("hello", () => this.helloReceived());
    connection.on("machine", () => this.machinesChanged());
    connection.on("machine_gone", ({ id }) => {
      if (id === this.session.selectedMachine && this.session.isDriving) this.sayDrivenMachineGone();
      this.machinesChanged();
    });
    connection.on("control", (message) => this.controlReceived(message));
    connection.on("error", ({ code, message }) => this.errorReceived(code, message));
    connection.on("bags", (message) => this.toolbar.receiveBags(message));
    connection.on("recording", (message) => this.toolbar.receiveRecording(message));
    connection.on("timeline", (message) => this.timeline.receive(message));
    let isFirst = true;
    connection.onStatus((status) => {
      if (status !== "online" && this.session.isDriving) this.banners.lostWhileDriving();
      if (status !== "online") this.releaseInputs();
      this.session.setAvailable(status === "online" && world.hello?.may_drive === true);
      if (!isFirst) this.update();
      isFirst = false;
    });
  }

  private helloReceived(): void {
    const { hello } = this.app.world;
    const source = `${hello?.source} ${hello?.title}`;
    if (source !== this.shownSource) this.selection.forget();
    this.shownSource = source;
    this.session.selectMachine(null);
    this.session.setAvailable(hello?.may_drive === true);
    this.timeline.helloReceived();
    setAttribute(this.app.root, "data-source", hello?.source);
    document.title = hello?.title ? `${hello.title} – earthmoving_sim` : "earthmoving_sim";
    this.update();
  }

  private machinesChanged(): void {
    const { machines } = this.app.world;
    this.selectMachine(this.selection.pick(machines.keys(), this.session.selectedMachine, this.session.isDriving));
    const isFirstVisit = readSetting("help_seen") === null && new URLSearchParams(location.search).get("help") !== "no";
    if (machines.size > 0 && isFirstVisit && !isDialogOpen()) this.openHelp();
    this.help.refresh(); // the levers of a machine may arrive after its shape
    this.update();
  }

  private chooseMachine(id: string): void {
    this.selection.choose(id);
    this.selectMachine(id);
  }

  private selectMachine(id: string | null): void {
    const isNew = id !== this.session.selectedMachine;
    this.session.selectMachine(id, this.selection.isReplacement(id));
    if (id !== null && isNew) this.app.view.selectMachine(id);
  }

  /** Say once that another machine is selected than before. */
  private checkReplacement(): void {
    const isReplacement = this.selection.isReplacement(this.session.selectedMachine) && !showsBag(this.app);
    const machine = this.machine();
    const now = performance.now();
    if (!isReplacement || machine === null) this.replacedAt = null;
    else this.replacedAt ??= now;
    if (machine === null || this.replacedAt === null || now - this.replacedAt < REPLACEMENT_MS) return;
    this.replacedAt = Infinity;
    const name = formatName(machineName(machine));
    this.toasts.show(`The machine has gone. Selected now: ${name}; take control of it with the button.`, "error");
  }

  private controlReceived(message: ControlMessage): void {
    const wasDriving = this.session.isDriving;
    this.session.receiveControl(message);
    const { isDriving, selectedMachine } = this.session;
    if (isDriving && selectedMachine !== null) this.selection.choose(selectedMachine);
    if (!wasDriving || isDriving) return;
    this.lostControlAt = performance.now();
    const { driver } = this.session;
    if (driver !== null) this.toasts.show(`Viewer ${driver} took over the machine; your levers were released.`, "error");
    else this.sayDrivenMachineGone(); // the server releases the levers of a machine only then
  }

  private sayDrivenMachineGone(): void {
    const name = formatName(this.session.selectedMachine ?? "");
    this.toasts.show(`${name} has gone: its node has ended or does not answer. Your levers were released.`, "error");
  }

  private errorReceived(code: string, message: string): void {
    this.session.receiveError();
    if (this.app.connection.status !== "online") return;
    // A lever message that crossed a take-over, which has an explanation of its own.
    const isCrossing = this.session.isDriving || performance.now() - this.lostControlAt < TAKE_OVER_MS;
    if (code === "not_driving" && isCrossing) return;
    this.toasts.show(sentence(message), "error");
  }

  private drivingChanged(): void {
    if (this.driveBar === undefined) return; // while the parts are made
    this.driveBar.moveLevers();
    this.touch.move();
    this.driveBar.update();
    this.stop.update();
  }

  private isLever(name: string): boolean {
    const { connection } = this.app;
    const { hello } = this.app.world;
    const isLive = hello?.source === "live" && hello.may_drive && !connection.isStalled;
    return isLive && name in hello.keys && !isDialogOpen() && !this.login.isOpen;
  }

  private heldChanged(held: string[]): void {
    if (held.length > 0 && !this.session.takeControlByLever()) this.explainLever();
    this.session.setHeldKeys(held);
  }

  /** Say why a lever key moves nothing. */
  private explainLever(): void {
    const { driver, state } = this.session;
    if (state === "taken") this.toasts.show(`Viewer ${driver} drives this machine; "Take over" gives you the control.`);
    else if (state === "free") this.toasts.show("Another machine was selected: take control of it with the button.");
  }

  /** Receive a key that is no lever; return whether it had a meaning. */
  private pressed(name: string, event: KeyboardEvent): boolean {
    if (this.login.isOpen) return false;
    if (showsBag(this.app)) return !isDialogOpen() && (this.timeline.pressed(name, event.shiftKey) || this.pageKey(name));
    const meaning = this.app.world.hello?.action_keys[name];
    if (meaning !== undefined && name === " ") {
      this.stop.press(); // allowed to everyone
      return true;
    }
    if (meaning !== undefined && this.app.world.hello?.may_drive === true) {
      if (isDialogOpen()) return false;
      if (name === "x") this.stop.release();
      else if (name === "+" || name === "-") this.session.changeSpeed(name === "+" ? 1 : -1);
      else return this.pageKey(name);
      return true;
    }
    return !isDialogOpen() && this.pageKey(name);
  }

  private pageKey(name: string): boolean {
    const camera = /^[1-9]$/.test(name) ? this.app.view.cameras[Number(name) - 1] : undefined;
    if (camera !== undefined) this.toolbar.selectCamera(camera);
    else if (name === "o") this.overlay.toggleOpen();
    else if (name === "u") this.app.root.toggleAttribute("data-hidden");
    else if (name === "?" || name === "f1") this.openHelp();
    else return false;
    return true;
  }

  private focusLost(): void {
    if (!isAtRest(this.deflections())) {
      this.toasts.show("The page lost the focus: all levers were released.");
    }
    this.releaseInputs();
  }

  /** Release all levers, whatever holds them. */
  private releaseInputs(): void {
    this.keyboard?.releaseAll();
    this.touch.release();
    this.session.releaseLevers();
  }

  /** Release all levers while nothing arrives: what moves the machine would not be seen, and may arrive much later. */
  private checkSilence(): void {
    const { connection } = this.app;
    connection.advance(performance.now());
    if (connection.isStalled) this.releaseInputs();
  }

  private setTouch(on: boolean): void {
    writeSetting("touch", String(on));
    setAttribute(this.app.root, "data-touch", String(on));
    this.touch.setOn(on);
    this.driveBar.setTouch(on);
  }

  private openHelp(): void {
    this.releaseInputs();
    writeSetting("help_seen", "yes");
    this.help.open();
  }

  private openSource(source: "live" | { bag: string }): void {
    const address = new URL(location.href);
    if (source === "live") address.searchParams.delete("bag");
    else address.searchParams.set("bag", source.bag);
    history.replaceState(history.state, "", address);
    this.session.releaseControl();
    this.app.connection.login({ source });
  }

  private async readLayout(): Promise<void> {
    // Chromium only; elsewhere keys are shown as on a US keyboard.
    const { keyboard } = navigator as { keyboard?: { getLayoutMap?: () => Promise<ReadonlyMap<string, string>> } };
    try {
      this.layout = (await keyboard?.getLayoutMap?.()) ?? null;
    } catch {
      this.layout = null;
    }
  }

  private update(): void {
    this.sound.update(); // a hidden page is heard
    if (document.hidden) return;
    for (const part of this.parts) part.update();
    setAttribute(this.app.root, "data-quality", this.app.view.quality());
    this.login.update();
  }
}
