/** Playback of a bag: play, pause, seek, rate. */

import { clamp } from "../clamp";
import type { TimelineMessage } from "../protocol";
import { showsBag, type Part, type UiContext } from "./context";
import { make, makeButton, setAttribute, setProperty, setShown, setText } from "./dom";
import { formatNumber, formatTime } from "./format";
import { makeIcon } from "./icons";

const RATES = [0.1, 0.2, 0.5, 1, 2, 5, 10];

/** Minimum time between two seeks while the slider is dragged [ms]. */
const SEEK_INTERVAL_MS = 100;

/** Time without progress after which the page shows that it waits [ms]. */
const STALL_MS = 800;

/** A seek has arrived when the server is this near to its goal [s]. */
const SEEK_TOLERANCE = 0.5;

const KEY_STEP = 5;

export class Timeline implements Part {
  private readonly play: HTMLButtonElement;
  private readonly icons = { play: makeIcon("play"), pause: makeIcon("pause") };
  private readonly slider = make("input", {
    type: "range",
    min: 0,
    max: 0,
    step: "any",
    class: "timeline-slider",
    "data-testid": "timeline-slider",
    "aria-label": "Time in the bag",
  });
  private readonly time = make("output", { class: "timeline-time", "data-testid": "timeline-time" });
  private readonly duration = make("span", { class: "timeline-time", "data-testid": "timeline-duration" });
  private readonly rate = make("output", { class: "timeline-rate", "data-testid": "timeline-rate" });
  private readonly waiting = make("span", { class: "chip", role: "status", "data-testid": "timeline-waiting", hidden: true }, "Loading…");
  private state: TimelineMessage | null = null;
  /** Goal of a seek that the server has not reached yet [s from the start]. */
  private goal: number | null = null;
  /** Name of the bag that is shown; empty without one. */
  private bag = "";
  private isDragging = false;
  private lastSeek = 0;
  private lastProgress = 0;
  /** What is shown again when the connection to this bag is back. */
  private kept: { bag: string; state: TimelineMessage } | null = null;
  readonly element: HTMLElement;

  constructor(private readonly context: UiContext) {
    this.play = makeButton(
      { testId: "timeline-play", label: "Play", class: "tool", onClick: () => this.togglePlay() },
      this.icons.play,
    );
    const rateButton = (label: string, testId: string, text: string, steps: number): HTMLButtonElement =>
      makeButton({ testId, label, class: "tool", onClick: () => this.changeRate(steps) }, text);
    this.slider.addEventListener("input", () => this.drag());
    this.slider.addEventListener("change", () => this.drop());
    this.element = make(
      "section",
      { class: "panel timeline", "data-testid": "timeline", "aria-label": "Playback", hidden: true },
      this.play,
      this.time,
      this.slider,
      this.duration,
      this.waiting,
      make(
        "div",
        { class: "segments", role: "group", "aria-label": "Rate" },
        rateButton("Slower", "timeline-slower", "−", -1),
        this.rate,
        rateButton("Faster", "timeline-faster", "+", 1),
      ),
    );
  }

  /** Receive that a source was opened: its playback begins at the start. */
  helloReceived(): void {
    const { hello } = this.context.app.world;
    if (this.state !== null && this.bag !== "") this.kept = { bag: this.bag, state: this.state };
    this.bag = showsBag(this.context.app) ? (hello?.title ?? "") : "";
    this.state = this.goal = null;
    if (this.kept?.bag !== this.bag) this.kept = null;
  }

  receive(message: TimelineMessage): void {
    if (this.kept !== null) {
      const { state } = this.kept;
      this.kept = null;
      this.state = message;
      this.continueAt(state);
    }
    if (message.time !== this.state?.time || message.paused) this.lastProgress = performance.now();
    this.state = message;
    if (this.goal !== null && Math.abs(message.time - message.start - this.goal) < SEEK_TOLERANCE) this.goal = null;
    this.update();
  }

  /** Receive a key; return whether it had a meaning. */
  pressed(name: string, isShift: boolean): boolean {
    if (this.element.hidden || this.state === null) return false;
    const step = isShift ? 1 : KEY_STEP;
    switch (name) {
      case " ":
      case "k":
        this.togglePlay();
        return true;
      case "left":
        this.seek(this.position - step);
        return true;
      case "right":
        this.seek(this.position + step);
        return true;
      case "home":
        this.seek(0);
        return true;
      case "end":
        this.seek(this.length);
        return true;
      case ",":
      case "-":
        this.changeRate(-1);
        return true;
      case ".":
      case "+":
        this.changeRate(1);
        return true;
      default:
        return false;
    }
  }

  update(): void {
    const { state } = this;
    setShown(this.element, showsBag(this.context.app));
    if (state === null || this.element.hidden) return;
    const max = this.length.toFixed(3);
    if (this.slider.max !== max) this.slider.max = max;
    if (!this.isDragging) this.slider.value = String(this.position);
    setProperty(this.slider, "--share", `${((100 * this.position) / Math.max(this.length, 1e-3)).toFixed(2)}%`);
    setText(this.time, formatTime(this.position));
    setText(this.duration, formatTime(this.length));
    setAttribute(this.slider, "aria-valuetext", `${formatTime(this.position)} of ${formatTime(this.length)}`);
    setText(this.rate, `${formatNumber(state.rate, state.rate < 1 ? 1 : 0)}×`);
    const icon = state.paused ? this.icons.play : this.icons.pause;
    if (this.play.firstChild !== icon) this.play.replaceChildren(icon);
    const label = state.paused ? "Play" : "Pause";
    setAttribute(this.play, "aria-label", label);
    setAttribute(this.play, "title", `${label} (space bar)`);
    const isAtEnd = state.time >= state.end - 1e-3;
    const isStalled = !state.paused && !isAtEnd && performance.now() - this.lastProgress > STALL_MS;
    setShown(this.waiting, this.goal !== null || isStalled);
  }

  private get length(): number {
    return this.state === null ? 0 : Math.max(this.state.end - this.state.start, 0);
  }

  /** Time that is shown [s from the start]: that of the server, or the goal of a seek. */
  private get position(): number {
    if (this.goal !== null) return this.goal;
    return this.state === null ? 0 : this.state.time - this.state.start;
  }

  /** Continue a bag where it was shown when the connection was lost. */
  private continueAt({ time, start, rate, paused }: TimelineMessage): void {
    const { connection } = this.context.app;
    connection.send({ type: "playback", action: "rate", value: rate });
    connection.send({ type: "playback", action: paused ? "pause" : "play" });
    this.seek(time - start);
  }

  private togglePlay(): void {
    if (this.state === null) return;
    const isAtEnd = this.state.time >= this.state.end - 1e-3;
    if (this.state.paused && isAtEnd) this.seek(0);
    this.context.app.connection.send({ type: "playback", action: this.state.paused ? "play" : "pause" });
  }

  private changeRate(steps: number): void {
    if (this.state === null) return;
    const { rate } = this.state;
    const nearest = RATES.reduce((best, each, i) => {
      return Math.abs(each - rate) < Math.abs((RATES[best] ?? 1) - rate) ? i : best;
    }, 0);
    const value = RATES[clamp(nearest + steps, 0, RATES.length - 1)] ?? 1;
    this.context.app.connection.send({ type: "playback", action: "rate", value });
  }

  private drag(): void {
    this.isDragging = true;
    this.goal = Number(this.slider.value);
    const now = performance.now();
    if (now - this.lastSeek > SEEK_INTERVAL_MS) this.seek(this.goal);
    this.update();
  }

  private drop(): void {
    this.isDragging = false;
    this.seek(Number(this.slider.value));
  }

  private seek(position: number): void {
    const value = clamp(position, 0, this.length);
    this.lastSeek = performance.now();
    // Without a connection nothing is sought, and no answer ends the wait for the goal.
    this.goal = this.context.app.connection.send({ type: "playback", action: "seek", value }) ? value : null;
    this.update();
  }
}
