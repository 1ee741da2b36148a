"""Bad commands: each is refused with a sentence, whole, and what was in force stays."""

import array

import numpy as np
import pytest

from machine_sim.commands import CommandArbiter, CommandError, CommandParams
from machine_sim.commands.position_control import POSITION_TOLERANCE

HOME = (0.0, -0.7, 1.85, 1.9)
NAN, INF = float("nan"), float("inf")

BAD = {
    "front too short": (lambda b: b.front([0.1, 0.1], 0.0), "has 2 values; give 4 .*swing, boom"),
    "front empty": (lambda b: b.front([], 0.0), "has 0 values; give 4"),
    "front too long": (lambda b: b.front([0.0] * 6, 0.0), "has 6 values; give 4"),
    "front NaN": (lambda b: b.front([0.1, NAN, 0.1, 0.1], 0.0), "number that is not finite"),
    "front infinite": (
        lambda b: b.front([0.1, 0.1, 0.1, -INF], 0.0),
        "number that is not finite",
    ),
    "front degrees": (lambda b: b.front([0.1, 20.0, 0.1, 0.1], 0.0), "boom.*0.45 rad/s.*units"),
    "front text": (lambda b: b.front(["a"] * 4, 0.0), "no list of numbers"),
    "front number": (lambda b: b.front(1.0, 0.0), "no list of numbers"),
    "front nested": (lambda b: b.front([[0.1] * 4], 0.0), "no list of numbers"),
    "front ragged": (lambda b: b.front([[0.1], 0.1], 0.0), "no list of numbers"),
    "tracks one": (lambda b: b.tracks([1.0], 0.0), "1 values; give 2 .*left, right"),
    "tracks NaN": (lambda b: b.tracks([1.0, NAN], 0.0), "finite"),
    "tracks mm/s": (lambda b: b.tracks([1.0, 900.0], 0.0), "right_track.*1.5 m/s"),
    "twist NaN": (lambda b: b.twist(NAN, 0.0, 0.0), "linear.x"),
    "twist infinite": (lambda b: b.twist(0.0, INF, 0.0), "angular.z"),
    "twist list": (lambda b: b.twist([1.0], 0.0, 0.0), "linear.x"),
    "twist degrees": (lambda b: b.twist(0.0, 45.0, 0.0), "45 rad/s.*left_track"),
    "twist huge": (lambda b: b.twist(10**400, 0.0, 0.0), "linear.x"),
    "unknown": (lambda b: b.joints(["boom", "bom"], [0.1, 0.1], [], 0.0), "bom.*swing, boom"),
    "twice": (lambda b: b.joints(["boom", "boom"], [0.1, 0.1], [], 0.0), "boom twice"),
    "no names": (lambda b: b.joints([], [], [], 0.0), "names no joint"),
    "name, no list": (lambda b: b.joints("boom", [0.1], [], 0.0), "give a list"),
    "names None": (lambda b: b.joints(None, [0.1], [], 0.0), "give a list"),
    "number as name": (lambda b: b.joints([1], [0.1], [], 0.0), "give a list"),
    "neither": (lambda b: b.joints(["boom"], [], [], 0.0), "neither"),
    "neither given": (lambda b: b.joints(["boom"], None, None, 0.0), "neither"),
    "both": (lambda b: b.joints(["boom"], [0.1], [0.0], 0.0), "both"),
    "fewer values": (lambda b: b.joints(["boom", "arm"], [0.1], [], 0.0), "2 names and 1 values"),
    "more values": (lambda b: b.joints(["boom"], [], [0.0, 0.0], 0.0), "1 names and 2 values"),
    "joint NaN": (lambda b: b.joints(["boom", "arm"], [0.1, NAN], [], 0.0), "finite"),
    "joint degrees": (lambda b: b.joints(["boom", "arm"], [0.1, 60.0], [], 0.0), "arm.*units"),
    "goal NaN": (lambda b: b.joints(["boom"], [], [NAN], 0.0), "finite"),
    "goal beyond": (lambda b: b.joints(["swing", "boom"], [], [0.1, 0.9], 0.0), "-1.05 to 0.85"),
    "goal below": (lambda b: b.joints(["arm"], [], [0.5], 0.0), "0.55 to 2.6"),
    "swing degrees": (lambda b: b.joints(["swing"], [], [90.0], 0.0), "rad"),
    "goal of track": (lambda b: b.joints(["left_track"], [], [1.0], 0.0), "a track has none"),
    "few axes": (lambda b: b.joy([0.0] * 5, [], 0.0), "has 5 axes and needs 6"),
    "axis NaN": (lambda b: b.joy([NAN] + [0.0] * 5, [], 0.0), "finite"),
    "axis raw": (lambda b: b.joy([0.0, 32767.0] + [0.0] * 4, [], 0.0), "axis 1 .joy_left_y."),
    "buttons NaN": (lambda b: b.joy([0.0] * 6, [NAN], 0.0), "buttons"),
    "stop text": (lambda b: b.emergency_stop("false"), "true or false"),
    "time NaN": (lambda b: b.front([0.2] * 4, NAN), "time"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_command_is_refused_and_the_last_good_one_kept(arbiter, name):
    command, sentence = BAD[name]
    b = arbiter()
    b.front([0.1] * 4, 0.0)
    b.tracks([0.3, 0.4], 0.0)
    with pytest.raises(CommandError, match=sentence):
        command(b)
    applied = b.command_at(0.0, HOME)
    assert applied.joints.tolist() == [0.1] * 4
    assert applied.tracks.tolist() == [0.3, 0.4]


def test_command_as_it_comes_out_of_a_ros_message(arbiter):
    b = arbiter()
    b.front(array.array("d", [0.1, 0.2, 0.3, 0.4]), 0.0)
    b.joints(["left_track"], array.array("d", [1.0]), array.array("d"), 0.0)
    applied = b.command_at(0.0, HOME)
    assert applied.joints.tolist() == [0.1, 0.2, 0.3, 0.4]
    assert applied.tracks.tolist() == [1.0, 0.0]


def test_values_up_to_the_mistake_of_units_pass(arbiter, spec):
    b = arbiter(unit_error_factor=2.0)
    top = spec.joints["swing"].max_velocity
    b.front([2.0 * top, 0.0, 0.0, 0.0], 0.0)
    with pytest.raises(CommandError, match="2 times"):
        b.front([2.001 * top, 0.0, 0.0, 0.0], 0.0)


def test_goal_at_the_limit_as_measured_is_the_limit(arbiter, spec):
    b, upper = arbiter(), spec.joints["boom"].upper
    b.joints(["boom"], [], [upper + 0.9 * POSITION_TOLERANCE], 0.0)
    assert b.command_at(0.0, (0.0, upper, 1.0, 1.0)).joints[1] == 0.0


def test_error_of_a_long_message_is_short(arbiter):
    with pytest.raises(CommandError) as caught:
        arbiter().front(np.full(100_000, np.nan), 0.0)
    assert len(str(caught.value)) < 300


STAMPED = {
    "joints": lambda b, **stamp: b.joints(["boom"], [0.1], [], 50.0, **stamp),
    "twist": lambda b, **stamp: b.twist(0.5, 0.0, 50.0, **stamp),
    "joy": lambda b, **stamp: b.joy([0.5] * 6, [0] * 11, 50.0, **stamp),
}


@pytest.mark.parametrize("command", STAMPED.values(), ids=STAMPED)
def test_stamps_are_not_looked_at_unless_asked_for(arbiter, command):
    b = arbiter()
    for stamp in (None, 0.0, 1e9, NAN):
        command(b, stamp=stamp, sim_now=10.0)


@pytest.mark.parametrize("command", STAMPED.values(), ids=STAMPED)
@pytest.mark.parametrize(
    ("stamp", "sentence"),
    [(9.5, "0.5 s old"), (10.2, "0.2 s in the future"), (None, "stamp"), (NAN, "stamp")],
)
def test_stale_and_future_stamps_are_refused_when_checked(arbiter, command, stamp, sentence):
    b = arbiter(check_stamps=True)
    with pytest.raises(CommandError, match=sentence):
        command(b, stamp=stamp, sim_now=10.0)
    applied = b.command_at(50.0, HOME)
    assert set(applied.joint_sources + applied.track_sources) == {"none"}


@pytest.mark.parametrize("command", STAMPED.values(), ids=STAMPED)
@pytest.mark.parametrize("stamp", [9.8, 10.0, 10.01])
def test_stamps_of_now_pass_when_checked(arbiter, command, stamp):
    b = arbiter(check_stamps=True)
    command(b, stamp=stamp, sim_now=10.0)
    applied = b.command_at(50.0, HOME)
    assert set(applied.joint_sources + applied.track_sources) != {"none"}


def test_time_of_arrival_is_simulation_time_where_none_is_given(arbiter):
    b = arbiter(check_stamps=True)
    b.twist(0.5, 0.0, 50.0, stamp=49.9)
    with pytest.raises(CommandError, match="old"):
        b.twist(0.5, 0.0, 50.0, stamp=49.0)


def test_board_has_shipped_parameters_by_default(spec):
    assert CommandArbiter(spec).params == CommandParams()
