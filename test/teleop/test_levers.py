"""Deflections from keys, and the Joy message from which a machine reads them."""

from __future__ import annotations

import itertools
from pathlib import Path

import pytest

from machine_sim.commands import TRACK_NAMES, CommandParams
from machine_sim.commands.actuators import Actuator
from machine_sim.commands.joystick import Joystick
from teleop.joy_axes import to_joy
from teleop.key_layout import ACTION_KEYS, CONTROLS, KEYS
from teleop.levers import Levers
from teleop.terminal_page import MachineView, page_lines


def test_lever_moves_while_its_key_is_held_and_returns_at_once() -> None:
    levers = Levers()
    levers.update({"i"}, 0.1)
    assert levers.deflections["right_y"] == pytest.approx(0.5)
    levers.update({"i"}, 1.0)
    assert levers.deflections["right_y"] == 1.0
    levers.update({"k"}, 0.02)
    assert levers.deflections["right_y"] == pytest.approx(-0.1)
    levers.update((), 0.02)
    assert set(levers.deflections.values()) == {0.0}


def test_keys_of_both_hands_act_together_and_opposite_ones_cancel() -> None:
    levers = Levers()
    levers.update({"w", "j", "up", "left", "?"}, 1.0)
    deflected = {name: value for name, value in levers.deflections.items() if value}
    assert deflected == {"left_y": 1.0, "right_x": 1.0, "right_pedal": 1.0}


def test_speed_limits_the_deflection_from_a_tenth_to_all() -> None:
    levers = Levers(0.5)
    levers.update({"a"}, 1.0)
    assert levers.deflections["left_x"] == 0.5
    levers.change_speed(-20)
    assert levers.speed == 0.1
    levers.change_speed(20)
    assert levers.speed == 1.0


def test_every_control_has_a_key_for_each_direction() -> None:
    for control, sign in itertools.product(CONTROLS, (1.0, -1.0)):
        assert {control: sign} in KEYS.values()


def test_keys_are_documented_and_shown() -> None:
    page = (Path(__file__).parents[2] / "docs/teleop.md").read_text(encoding="utf-8")
    shown = "\n".join(page_lines("/m", MachineView(), Levers().deflections, 1.0, has_releases=True))
    keys = {*KEYS, *ACTION_KEYS} - {"up", "down", "left", "right"}
    for key in {"space" if key == " " else key for key in keys}:
        assert f"`{key}`" in page or key == "space"
        assert f" {key} " in shown


@pytest.mark.parametrize(
    "params",
    [
        CommandParams(),
        CommandParams(joy_deadzone=0.3, joy_left_x=7, joy_pattern="sae"),
        CommandParams(joy_pedal_rest=1.0, joy_left_pedal=6),  # triggers, reversed by buttons
        CommandParams(joy_pedal_rest=-1.0, joy_pedal_full=1.0),
    ],
)
@pytest.mark.parametrize("deflection", [1.0, 0.05, 0.0, -0.05, -1.0])
def test_machine_reads_the_deflection_of_each_control(
    params: CommandParams, deflection: float
) -> None:
    joints = ["left_x", "left_y", "right_x", "right_y"]
    actuators = [Actuator(name, 1.0, "", None) for name in [*joints, *TRACK_NAMES]]
    joystick = Joystick(actuators, params, {name: (name, 1.0) for name in joints})
    for control in CONTROLS:
        values = to_joy({**dict.fromkeys(CONTROLS, 0.0), control: deflection}, params)
        reading = joystick.read(values.axes, values.buttons)
        expected = {**dict.fromkeys(CONTROLS, 0.0), control: deflection}
        assert [*reading.joints, *reading.tracks] == pytest.approx(list(expected.values()))
