/** Payloads of the machines beside the selected one: whoever loads a truck looks at its bed, and not at a menu. */

import type { MachineState } from "../world_state";
import { BarRow } from "./bars";
import { machineName, type UiContext } from "./context";
import { make, setShown } from "./dom";
import { formatName, formatValue } from "./format";

export class OtherPayloads {
  private readonly rows = new Map<string, BarRow>();
  private readonly list = make("div", { class: "rows" });
  readonly element = make("div", { "data-testid": "other-payloads" }, make("h3", {}, "Payload of others"), this.list);

  constructor(private readonly context: UiContext) {}

  update(): void {
    const selected = this.context.machine();
    const others = [...this.context.app.world.machines.values()].filter(
      (each) => each.id !== selected?.id && each.gauges.payload !== undefined,
    );
    setShown(this.element, others.length > 0);
    if (others.length !== this.rows.size || others.some(({ id }) => !this.rows.has(id))) this.show(others);
    for (const { id, gauges } of others) showPayload(this.rows.get(id), gauges.payload?.fill ?? 0);
  }

  private show(machines: readonly MachineState[]): void {
    this.rows.clear();
    for (const machine of machines) {
      this.rows.set(machine.id, new BarRow(formatName(machineName(machine)), `payload-fill-${machine.id}`, ["payload"]));
    }
    this.list.replaceChildren(...[...this.rows.values()].map((row) => row.element));
  }
}

/** Show how full a bucket or a bed is; 1 is full. */
export function showPayload(row: BarRow | undefined, fill: number): void {
  row?.setFill(0, fill, fill > 1.05);
  row?.setValue(formatValue(100 * fill, 0, "%"));
}
