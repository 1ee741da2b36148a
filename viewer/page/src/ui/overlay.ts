/** Panel with the state of connection, simulation, ledger and machine. */

import { ValueRow } from "./bars";
import { showsBag, type Part, type UiContext } from "./context";
import { make, makeButton, setAttribute, setShown, setText } from "./dom";
import { Conditions } from "./conditions";
import { formatInteger, formatName, formatNumber, formatValue, formatVolume, UNKNOWN } from "./format";
import { makeIcon } from "./icons";
import { MachineSection } from "./machine_section";
import { readSetting, writeSetting } from "./settings";
import { TickProgress } from "./tick_progress";

/** Accounts of the ledger, in the order of its documentation. */
const ACCOUNTS = ["terrain", "particles", "pending", "in_flight", "absent", "outside"] as const;

const STATUS_TEXT = {
  connecting: "Connecting",
  online: "Connected",
  waiting: "Connection lost",
  refused: "Not admitted",
  closed: "Disconnected",
} as const;

export class Overlay implements Part {
  private readonly title = make("h1", { "data-testid": "title" }, "earthmoving_sim");
  private readonly status = make("span", { "data-testid": "connection-status" });
  private readonly dot = make("span", { class: "status-dot", "aria-hidden": "true" });
  private readonly simulation = new SimulationSection();
  private readonly ledger = new LedgerSection();
  private readonly machine: MachineSection;
  private readonly toggle: HTMLButtonElement;
  private readonly body = make("div", { class: "panel-body", id: "overlay-body" });
  readonly element: HTMLElement;

  constructor(private readonly context: UiContext) {
    this.machine = new MachineSection(context);
    this.toggle = makeButton(
      {
        testId: "overlay-toggle",
        label: "Show or hide the gauges",
        title: "Show or hide the gauges (O)",
        class: "icon-button",
        onClick: () => this.setOpen(this.body.hidden),
      },
      makeIcon("chevron"),
    );
    this.toggle.setAttribute("aria-controls", "overlay-body");
    this.body.append(this.simulation.element, this.ledger.element, this.machine.element);
    const heading = make(
      "header",
      { class: "panel-header" },
      this.dot,
      make("div", { class: "panel-title" }, this.title, make("small", { role: "status" }, this.status)),
      this.toggle,
    );
    this.element = make(
      "section",
      { class: "panel overlay", "data-testid": "overlay", "aria-label": "State of simulation and machine" },
      heading,
      this.body,
    );
    const kept = readSetting("overlay");
    this.setOpen(kept === null ? !matchMedia("(width <= 620px)").matches : kept === "open");
  }

  /** Open or close the body of the panel. */
  setOpen(isOpen: boolean): void {
    setShown(this.body, isOpen);
    setAttribute(this.toggle, "aria-expanded", String(isOpen));
    writeSetting("overlay", isOpen ? "open" : "closed");
    this.update();
  }

  toggleOpen(): void {
    this.setOpen(this.body.hidden);
  }

  update(): void {
    const { connection, world } = this.context.app;
    setText(this.title, world.hello?.title || "earthmoving_sim");
    setText(this.status, connection.isStalled ? "No answer" : statusText(connection.status, world.hello?.source));
    setAttribute(this.dot, "data-status", connection.isStalled ? "waiting" : connection.status);
    if (this.body.hidden) return;
    this.simulation.update(this.context);
    this.ledger.update(this.context);
    this.machine.update();
  }
}

class SimulationSection {
  private readonly time = new ValueRow("Time", "sim-time", "Simulation time");
  private readonly tick = new ValueRow("Tick", "tick");
  private readonly factor = new ValueRow("Real time", "rtf", "Simulated time per second of the wall clock");
  private readonly state = new ValueRow("State", "sim-state");
  private readonly latency = new ValueRow("Latency", "latency", "From the server to this page and back");
  private readonly fps = new ValueRow("Display", "fps", "Drawn frames per second");
  private readonly conditions = new Conditions();
  private readonly progress = new TickProgress();
  readonly element = make(
    "details",
    { class: "section", open: true, "data-testid": "section-simulation" },
    make("summary", {}, make("h2", {}, "Simulation")),
    make(
      "div",
      { class: "rows two-columns" },
      this.time.element,
      this.tick.element,
      this.factor.element,
      this.state.element,
      this.latency.element,
      this.fps.element,
    ),
    this.conditions.element,
  );

  update({ app }: UiContext): void {
    const { frame } = app.world;
    const isStill = this.progress.update(frame?.tick ?? null, performance.now());
    const isStuck = isStill && frame?.paused === false && !showsBag(app);
    this.time.setValue(formatValue(frame?.time, 2, "s"));
    this.tick.setValue(frame === null || frame.tick < 0 ? UNKNOWN : formatInteger(frame.tick));
    this.factor.setValue(frame ? `× ${formatNumber(isStuck ? 0 : frame.rtf, 2)}` : UNKNOWN);
    setAttribute(this.factor.element, "data-warning", frame !== null && !frame.paused && frame.rtf < 0.9);
    this.state.setValue(frame === null ? UNKNOWN : frame.paused ? "paused" : isStuck ? "no ticks" : "running");
    setAttribute(this.state.element, "data-warning", frame?.paused === true || isStuck);
    this.latency.setValue(formatValue(frame?.latency_ms, 0, "ms"));
    this.fps.setValue(formatValue(app.view.framesPerSecond(), 0, "fps"));
    this.conditions.update(frame?.status ?? {});
  }
}

class LedgerSection {
  private readonly imbalance = make("strong", { class: "imbalance-value", "data-testid": "imbalance" });
  private readonly imbalanceRow = make(
    "div",
    {
      class: "imbalance",
      title: "Sum of all accounts minus the sum at the start of the run: soil that was lost or created",
    },
    make("span", { class: "row-label" }, "Imbalance"),
    this.imbalance,
  );
  private readonly accounts = new Map(
    ACCOUNTS.map((name) => [name, new ValueRow(formatName(name), `ledger-${name}`)] as const),
  );
  readonly element = make(
    "details",
    { class: "section", open: true, "data-testid": "section-ledger" },
    make("summary", {}, make("h2", {}, "Ledger ", make("small", {}, "bank volume, m³"))),
    this.imbalanceRow,
    make("div", { class: "rows two-columns ledger-accounts" }, ...[...this.accounts.values()].map((row) => row.element)),
  );

  update({ app }: UiContext): void {
    const ledger = app.world.frame?.ledger ?? {};
    const imbalance = imbalanceOf(ledger);
    setText(this.imbalance, formatValueInteger(imbalance));
    const state = imbalance === undefined ? "unknown" : imbalance === 0 ? "balanced" : "unbalanced";
    setAttribute(this.imbalanceRow, "data-state", state);
    for (const [name, row] of this.accounts) row.setValue(formatVolume(ledger[name]));
  }
}

/** Return what the ledger lost or created [mm³]: as the server states it, or computed from the accounts. */
function imbalanceOf(ledger: Record<string, number>): number | undefined {
  if (ledger.imbalance !== undefined) return ledger.imbalance;
  const { start } = ledger;
  if (start === undefined) return undefined;
  return ACCOUNTS.reduce((sum, name) => sum + (ledger[name] ?? 0), -start);
}

function formatValueInteger(mm3: number | undefined): string {
  return mm3 === undefined ? UNKNOWN : `${formatInteger(mm3)} mm³`;
}

function statusText(status: keyof typeof STATUS_TEXT, source: "live" | "bag" | undefined): string {
  if (status !== "online") return STATUS_TEXT[status];
  return source === "bag" ? "Bag" : "Live";
}
