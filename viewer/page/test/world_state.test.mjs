import assert from "node:assert/strict";
import { describe, it } from "node:test";
import { pressureScale } from "../src/ui/machine_section";
import { TerrainState, WorldState } from "../src/world_state";

const machine = (changes = {}, levers = { boom: "right_y" }) => ({
  type: "machine",
  id: "/digger",
  namespace: "/digger",
  model: {
    name: "digger",
    links: [{ name: "boom", visuals: [{ kind: "mesh", glb: Uint8Array.of(1, 2, 3) }] }],
    joints: [{ name: "boom", lower: -1, upper: null }],
    tracks: [],
    engine: null,
    hydraulics: null,
    ...changes,
  },
  levers,
  pattern: "iso",
});

/** Return a world and the function that gives it a message. */
function world() {
  const handlers = new Map();
  const state = new WorldState({ on: (type, handler) => handlers.set(type, handler) });
  return [state, (message) => handlers.get(message.type)(message)];
}

describe("a machine that is described again", () => {
  it("stays the same if nothing differs", () => {
    const [state, receive] = world();
    receive(machine());
    const before = state.machines.get("/digger");
    const { message } = before;
    receive(machine());
    assert.equal(state.machines.get("/digger"), before);
    assert.equal(before.message, message);
  });

  it("keeps its state and its model if only the levers differ", () => {
    const [state, receive] = world();
    receive(machine());
    const before = state.machines.get("/digger");
    const { model } = before.message;
    receive(machine({}, { boom: "-right_y" }));
    assert.equal(state.machines.get("/digger"), before);
    assert.equal(before.message.levers.boom, "-right_y");
    assert.equal(before.message.model, model);
  });

  it("is another one if its shapes differ", () => {
    const [state, receive] = world();
    receive(machine());
    const before = state.machines.get("/digger");
    receive(machine({ links: [{ name: "boom", visuals: [{ kind: "mesh", glb: Uint8Array.of(1, 2, 4) }] }] }));
    assert.notEqual(state.machines.get("/digger"), before);
  });
});

describe("the moisture at a position", () => {
  const terrain = new TerrainState({ rows: 3, cols: 2, cell: 1, reference: new Uint8Array(24), design: null });
  for (let i = 0; i < 6; i++) terrain.cells[4 * i + 1] = 10 * i;

  it("is that of the nearest cell", () => {
    assert.equal(terrain.moistureAt(0.9, 0.6), 0); // the first cell is that at +x, +y
    assert.equal(terrain.moistureAt(0.1, -0.4), 30);
    assert.equal(terrain.moistureAt(-0.6, 0.3), 40);
  });

  it("is that of the border for a position outside", () => {
    assert.equal(terrain.moistureAt(-50, 50), 40);
    assert.equal(terrain.moistureAt(50, -50), 10);
  });
});

describe("the scale of pressures", () => {
  it("is that of the machine", () => {
    const hydraulics = { main_relief_pressure: 25e6, port_relief_pressure: 28e6 };
    assert.deepEqual(pressureScale(machine({ hydraulics })), { full: 28e6, relief: 25e6 });
  });

  it("is 35 MPa for a machine that does not state it", () => {
    assert.deepEqual(pressureScale(machine()), { full: 35e6, relief: 35e6 });
  });
});
