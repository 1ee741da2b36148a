import assert from "node:assert/strict";
import { beforeEach, describe, it } from "node:test";
import { DrivingSession } from "../src/driving/driving_session";
import { MachineSelection } from "../src/driving/machine_selection";

const MACHINE = "/excavator";

describe("a driving session", () => {
  let sent;
  let session;
  let delayed;
  let now;

  beforeEach(() => {
    now = 0;
    sent = [];
    delayed = [];
    session = new DrivingSession(
      (message) => sent.push(message),
      () => {},
      (call) => delayed.push(call),
      () => now,
    );
    session.setAvailable(true);
    session.selectMachine(MACHINE);
  });

  const drivers = (isYou) => ({ type: "control", drivers: { [MACHINE]: { id: "1", is_you: isYou } } });
  const drive = () => {
    session.takeControl();
    session.receiveControl(drivers(true));
    sent.length = 0;
  };
  const lastDrive = () => sent.filter((message) => message.type === "drive").at(-1);

  it("sends nothing before it has control", () => {
    session.setHeldKeys(["w"]);
    session.tick();
    assert.deepEqual(sent, []);
  });

  it("sends a change at once, and the same levers at each tick, with the time", () => {
    drive();
    session.setHeldKeys(["w"]);
    now = 50;
    session.tick();
    const expected = { type: "drive", machine: MACHINE, held: ["w"], deflections: {} };
    assert.deepEqual(sent, [{ ...expected, time: 0 }, { ...expected, time: 0.05 }]);
  });

  it("begins with the keys that are held when control is granted", () => {
    session.takeControl();
    session.setHeldKeys(["w"]);
    session.receiveControl(drivers(true));
    assert.deepEqual(lastDrive().held, ["w"]);
  });

  it("takes control of a machine that replaces another one by a button only", () => {
    session.selectMachine("/truck", true);
    assert.equal(session.takeControlByLever(), false);
    session.setTouchDeflections({ left_x: 1 });
    assert.deepEqual(sent, []);
    session.takeControl();
    assert.deepEqual(sent, [{ type: "take_control", machine: "/truck" }]);
  });

  it("takes a machine from another page only by force", () => {
    session.receiveControl(drivers(false));
    session.takeControl();
    assert.deepEqual(sent, []);
    session.takeControl(true);
    assert.deepEqual(sent, [{ type: "take_control", machine: MACHINE, force: true }]);
  });

  it("releases the levers on an emergency stop", () => {
    drive();
    session.setHeldKeys(["w"]);
    session.setEmergencyStop(true);
    assert.deepEqual(lastDrive().held, []);
    assert.equal(sent.at(-1).type, "emergency_stop");
  });

  it("has no control after the connection was lost", () => {
    drive();
    session.setHeldKeys(["w"]);
    session.setAvailable(false);
    session.setAvailable(true);
    assert.equal(session.state, "free");
    sent.length = 0;
    session.tick();
    assert.deepEqual(sent, []);
  });

  it("ignores a stick that is deflected when control begins until it was released", () => {
    session.setDeflections("gamepad", { left_y: 1 });
    drive();
    session.tick();
    assert.deepEqual(lastDrive().deflections, {});
    session.setDeflections("gamepad", {});
    session.setDeflections("gamepad", { left_y: 0.5 });
    assert.deepEqual(lastDrive().deflections, { left_y: 0.5 });
  });

  it("begins with the on-screen lever whose deflection asked for control", () => {
    session.setDeflections("gamepad", { right_y: 1 });
    session.setTouchDeflections({});
    session.setTouchDeflections({ left_x: 0.5 });
    assert.deepEqual(sent, [{ type: "take_control", machine: MACHINE }]);
    session.setTouchDeflections({ left_x: 1 });
    session.receiveControl(drivers(true));
    assert.deepEqual(lastDrive().deflections, { left_x: 1 });
    session.setTouchDeflections({});
    assert.deepEqual(lastDrive().deflections, {});
  });

  it("neither begins nor moves with an on-screen lever that was deflected while another page drove", () => {
    session.receiveControl(drivers(false));
    session.setTouchDeflections({ left_x: 0.5 });
    session.receiveControl({ type: "control", drivers: {} });
    session.setTouchDeflections({ left_x: 1 });
    assert.deepEqual(sent, []);
    drive();
    session.setTouchDeflections({ left_x: 0.9 });
    session.tick();
    assert.deepEqual(lastDrive().deflections, {});
  });

  it("ignores an on-screen lever until its release if all levers were released before control was granted", () => {
    session.setTouchDeflections({ left_x: 1 });
    session.setEmergencyStop(true);
    session.receiveControl(drivers(true));
    assert.deepEqual(lastDrive().deflections, {});
  });

  it("adds the deflections of gamepad and touch, within the limits", () => {
    drive();
    session.setDeflections("gamepad", { left_y: 0.8, left_x: -0.2 });
    session.setDeflections("touch", { left_y: 0.8 });
    delayed.shift()();
    assert.deepEqual(lastDrive().deflections, { left_y: 1, left_x: -0.2 });
  });

  it("delays changes of deflections, but not a release", () => {
    const values = () => sent.map((message) => message.deflections.left_y ?? 0);
    drive();
    for (let k = 1; k <= 9; k++) session.setDeflections("touch", { left_y: k / 10 });
    assert.deepEqual(values(), [0.1]);
    assert.equal(session.deflections.left_y, 0.9);
    delayed.shift()();
    assert.deepEqual(values(), [0.1, 0.9]);
    session.setDeflections("touch", { left_y: 0.5 });
    session.setDeflections("touch", { left_y: 0.4 });
    session.setDeflections("touch", {});
    assert.equal(values().at(-1), 0);
  });

  it("asks again after a refusal", () => {
    session.takeControl();
    session.receiveError();
    assert.equal(session.state, "free");
  });
});

describe("the selection of a machine", () => {
  it("returns to the machine that was shown before a lost connection", () => {
    const selection = new MachineSelection();
    assert.equal(selection.pick(["/digger", "/truck"], null, false), "/digger");
    selection.choose("/truck");
    assert.equal(selection.pick(["/digger"], null, false), "/digger");
    assert.equal(selection.isReplacement("/digger"), true);
    assert.equal(selection.pick(["/digger", "/truck"], "/digger", false), "/truck");
    assert.equal(selection.isReplacement("/truck"), false);
  });

  it("keeps a replacement that is driven", () => {
    const selection = new MachineSelection();
    selection.choose("/truck");
    assert.equal(selection.pick(["/digger", "/truck"], "/digger", true), "/digger");
  });
});
