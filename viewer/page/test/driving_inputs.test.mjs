import assert from "node:assert/strict";
import { beforeEach, describe, it } from "node:test";
import { keyDeflections } from "../src/driving/deflections";
import { gamepadDeflections } from "../src/driving/gamepad_mapping";
import { Gamepads } from "../src/driving/gamepads";
import { Keyboard } from "../src/driving/keyboard";
import { HeldKeys } from "../src/driving/held_keys";
import { keyName } from "../src/driving/key_names";
import { StopEdge } from "../src/driving/stop_edge";
import { leverDeflection } from "../src/driving/touch_deflection";

describe("the name of a key", () => {
  it("is that of its position for letters, on any layout and with caps lock", () => {
    assert.equal(keyName({ code: "KeyY", key: "z" }), "y");
    assert.equal(keyName({ code: "KeyW", key: "Z" }), "w");
    assert.equal(keyName({ code: "KeyS", key: "ы" }), "s");
  });

  it("is that of its character for plus and minus", () => {
    assert.equal(keyName({ code: "BracketRight", key: "+" }), "+");
    assert.equal(keyName({ code: "Slash", key: "-" }), "-");
    assert.equal(keyName({ code: "NumpadAdd", key: "+" }), "+");
  });

  it("is known without a code", () => {
    assert.equal(keyName({ code: "", key: "W" }), "w");
    assert.equal(keyName({ code: "", key: "ArrowUp" }), "up");
  });
});

describe("held keys", () => {
  it("do not come back by repetition after all were released", () => {
    const held = new HeldKeys();
    held.press("w", false);
    held.releaseAll();
    held.press("w", true);
    assert.deepEqual(held.list, []);
    held.release("w");
    held.press("w", false);
    assert.deepEqual(held.list, ["w"]);
  });

  it("of opposite directions cancel each other", () => {
    const keys = { w: { left_y: 1 }, s: { left_y: -1 }, up: { left_pedal: 1, right_pedal: 1 } };
    assert.deepEqual(keyDeflections(["w", "s"], keys, 1), {});
    assert.deepEqual(keyDeflections(["s", "up"], keys, 0.5), { left_y: -0.5, left_pedal: 0.5, right_pedal: 0.5 });
  });
});

describe("a gamepad", () => {
  const buttons = (pressed) =>
    Array.from({ length: 17 }, (_, i) => ({ pressed: i in pressed, value: pressed[i] ?? 0 }));

  it("deflects to the left and forward as positive", () => {
    const { left_x, right_y } = gamepadDeflections({ axes: [-1, 0, 0, -1], buttons: buttons({}) });
    assert.deepEqual([left_x, right_y], [1, 1]);
  });

  it("is at rest within its dead zone", () => {
    const deflections = gamepadDeflections({ axes: [0.1, -0.1, 0.05, 0.11], buttons: buttons({}) });
    assert.ok(Object.values(deflections).every((value) => Math.abs(value) === 0));
  });

  it("drives a track forward by its trigger and backward by its shoulder button", () => {
    const { left_pedal, right_pedal } = gamepadDeflections({ axes: [], buttons: buttons({ 6: 1, 5: 1 }) });
    assert.deepEqual([left_pedal, right_pedal], [1, -1]);
  });
});

describe("the space bar", () => {
  it("is pressed also while Ctrl, Alt or Meta is held, which silence all other keys", () => {
    for (const name of ["HTMLElement", "HTMLInputElement"]) globalThis[name] ??= class {};
    const pressed = [];
    const listeners = {};
    const window = { addEventListener: (type, f) => (listeners[type] = f), document: { addEventListener() {} } };
    new Keyboard(window, {
      isLever: () => false,
      heldChanged() {},
      focusLost() {},
      pressed: (name) => pressed.push(name) > 0,
    });
    const event = { target: null, repeat: false, preventDefault() {}, stopPropagation() {} };
    for (const modifier of ["ctrlKey", "altKey", "metaKey"]) {
      listeners.keydown({ ...event, code: "Space", key: " ", [modifier]: true });
      listeners.keydown({ ...event, code: "KeyO", key: "o", [modifier]: true });
    }
    assert.deepEqual(pressed, [" ", " ", " "]);
  });
});

describe("a connected gamepad", () => {
  let pad;
  let pads;
  let window;
  let timers;
  let isBlocked;
  let deflection;
  let actions;

  beforeEach(() => {
    pad = { index: 0, id: "pad", mapping: "standard", axes: [0, 0, 0, 0], buttons: [] };
    pads = [pad];
    timers = new Map();
    isBlocked = false;
    deflection = 0;
    actions = [];
    const listeners = {};
    window = {
      listeners,
      addEventListener: (type, f) => (listeners[type] = f),
      setInterval: (f) => (timers.set(timers.size + 1, f), timers.size),
      clearInterval: (id) => timers.delete(id),
      navigator: { getGamepads: () => pads },
      document: { hidden: false },
    };
    new Gamepads(window, {
      isBlocked: () => isBlocked,
      deflected: ({ left_x }) => (deflection = Math.abs(left_x ?? 0)),
      stopPressed: () => actions.push("stop"),
      startPressed: () => actions.push("start"),
      connectionChanged() {},
    });
  });

  const runTimers = () => timers.forEach((f) => f());
  const read = (x) => {
    pad.axes = [x, 0, 0, 0];
    runTimers();
    return deflection;
  };
  const press = (isPressed) => {
    pad.buttons = Array.from({ length: 17 }, () => ({ pressed: isPressed, value: 0 }));
    runTimers();
  };

  it("is read without a drawn frame", () => {
    assert.equal(read(1), 1);
    press(true);
    press(false);
    assert.equal(read(0), 0);
    assert.deepEqual(actions, ["stop", "start"]);
  });

  it("stops the machine and does nothing else while a dialog is open, until its sticks were in their middle after that", () => {
    isBlocked = true;
    read(0);
    press(true);
    assert.equal(read(1), 0);
    assert.deepEqual(actions, ["stop"]);
    press(false);
    isBlocked = false;
    assert.equal(read(1), 0);
    read(0);
    assert.equal(read(1), 1);
  });

  it("does not move the machine from a hidden page", () => {
    assert.equal(read(1), 1);
    window.document.hidden = true;
    assert.equal(read(1), 0);
    read(0);
    assert.equal(read(1), 0);
    window.document.hidden = false;
    assert.equal(read(1), 0);
    read(0);
    assert.equal(read(1), 1);
  });

  it("that is no longer listed is at rest before its disconnection is reported", () => {
    read(1);
    pads = [null];
    runTimers();
    assert.equal(deflection, 0);
    window.listeners.gamepaddisconnected();
    assert.equal(timers.size, 0);
  });
});

describe("an on-screen lever", () => {
  it("moves one axis if the finger moves mostly along it", () => {
    const { x, y } = leverDeflection(-80, -10, 80);
    assert.ok(x > 0.95);
    assert.equal(Math.abs(y), 0);
  });

  it("moves both axes on a diagonal, and no farther than its travel", () => {
    const { x, y } = leverDeflection(400, 400, 80);
    assert.ok(x < -0.6 && x >= -1 && y < -0.6 && y >= -1);
  });
});

describe("an emergency stop that the machine reports", () => {
  it("releases the levers once for each press and machine", () => {
    const edge = new StopEdge();
    const states = [["/a", false], ["/a", true], ["/a", true], ["/b", false], ["/a", true], ["/a", false], ["/a", true]];
    const releases = states.map(([machine, isStopped]) => edge.update(machine, isStopped));
    assert.deepEqual(releases, [false, true, false, false, true, false, true]);
  });
});
