import assert from "node:assert/strict";
import { describe, it } from "node:test";
import { formatInteger, formatNumber, formatTime, formatVolume } from "../src/ui/format";
import { legendOf } from "../src/terrain/colorings";
import { controlWords } from "../src/ui/joint_words";
import { TickProgress } from "../src/ui/tick_progress";

describe("numbers", () => {
  it("have no sign at zero", () => {
    assert.equal(formatNumber(-0.04, 1), "0.0");
    assert.equal(formatNumber(-1.26, 1), "−1.3");
    assert.equal(formatVolume(-1e5), "0.000");
  });

  it("are grouped by three digits", () => {
    assert.equal(formatInteger(-1234567), "−1\u202f234\u202f567");
  });

  it("of a time carry to the next minute and hour", () => {
    assert.equal(formatTime(59.96), "1:00.0");
    assert.equal(formatTime(3600), "1:00:00.0");
  });
});

describe("the words of a lever", () => {
  const machine = (levers) => ({
    levers,
    model: {
      joints: [
        { name: "boom", type: "revolute", axis: [0, 1, 0] },
        { name: "turret", type: "continuous", axis: [0, 0, 1] },
      ],
    },
  });

  it("name the motion of the joint that it moves", () => {
    const excavator = machine({ boom: "right_y", arm: "-left_y" });
    assert.equal(controlWords(excavator, "right_y", 1), "boom down");
    assert.equal(controlWords(excavator, "right_y", -1), "boom up");
    assert.equal(controlWords(excavator, "left_y", 1), "arm out");
  });

  it("follow from the axis of a joint without words of its own", () => {
    assert.equal(controlWords(machine({ turret: "left_x" }), "left_x", 1), "turret left");
  });

  it("are empty where nothing moves", () => {
    assert.equal(controlWords(machine({}), "left_x", 1), "");
  });
});

describe("the legend of the soils", () => {
  it("has words for a soil without a name", () => {
    const { items } = legendOf("soil", { low: 0, high: 1 }, { soils: [{ name: "" }, { name: "loam" }] });
    assert.deepEqual(items.map(({ label }) => label), ["unnamed soil", "loam"]);
  });
});

describe("the progress of the ticks", () => {
  it("ends when none has come for some time", () => {
    const progress = new TickProgress();
    assert.equal(progress.update(7, 0), false);
    assert.equal(progress.update(7, 1500), false);
    assert.equal(progress.update(7, 2500), true);
    assert.equal(progress.update(8, 2600), false);
  });
});
