import assert from "node:assert/strict";
import { describe, it } from "node:test";
import { formatInteger, formatNumber, formatTime, formatVolume } from "../src/ui/format";
import { controlWords } from "../src/ui/joint_words";

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
