"""Invalid commands: each is rejected as a whole, and the commands in force stay."""

import array

import numpy as np
import pytest

from machine_sim.commands import CommandArbiter, CommandError, CommandParams
from machine_sim.commands.position_control import POSITION_TOLERANCE
from machine_sim.commands.validation import format_value

HOME = (0.0, -0.7, 1.85, 1.9)
NAN, INF = float("nan"), float("inf")

BAD = {
    "front too short": (
        lambda a: a.receive_front([0.1, 0.1], 0.0),
        "has 2 values; give 4 .*swing, boom",
    ),
    "front empty": (lambda a: a.receive_front([], 0.0), "has 0 values; give 4"),
    "front too long": (lambda a: a.receive_front([0.0] * 6, 0.0), "has 6 values; give 4"),
    "front NaN": (
        lambda a: a.receive_front([0.1, NAN, 0.1, 0.1], 0.0),
        "number that is not finite",
    ),
    "front infinite": (
        lambda a: a.receive_front([0.1, 0.1, 0.1, -INF], 0.0),
        "number that is not finite",
    ),
    "front degrees": (
        lambda a: a.receive_front([0.1, 20.0, 0.1, 0.1], 0.0),
        "boom.*0.87 rad/s.*units",
    ),
    "front text": (lambda a: a.receive_front(["a"] * 4, 0.0), "list of numbers"),
    "front number": (lambda a: a.receive_front(1.0, 0.0), "list of numbers"),
    "front nested": (lambda a: a.receive_front([[0.1] * 4], 0.0), "list of numbers"),
    "front ragged": (lambda a: a.receive_front([[0.1], 0.1], 0.0), "list of numbers"),
    "tracks one": (lambda a: a.receive_tracks([1.0], 0.0), "1 values; give 2 .*left, right"),
    "tracks NaN": (lambda a: a.receive_tracks([1.0, NAN], 0.0), "finite"),
    "tracks mm/s": (lambda a: a.receive_tracks([1.0, 900.0], 0.0), "right_track.*1.58 m/s"),
    "twist NaN": (lambda a: a.receive_twist(NAN, 0.0, 0.0), "linear.x"),
    "twist infinite": (lambda a: a.receive_twist(0.0, INF, 0.0), "angular.z"),
    "twist list": (lambda a: a.receive_twist([1.0], 0.0, 0.0), "linear.x"),
    "twist degrees": (lambda a: a.receive_twist(0.0, 45.0, 0.0), "45 rad/s.*left_track"),
    "twist huge": (lambda a: a.receive_twist(10**400, 0.0, 0.0), "linear.x"),
    "unknown": (
        lambda a: a.receive_joints(["boom", "bom"], [0.1, 0.1], [], 0.0),
        "bom.*swing, boom",
    ),
    "twice": (lambda a: a.receive_joints(["boom", "boom"], [0.1, 0.1], [], 0.0), "boom twice"),
    "no names": (lambda a: a.receive_joints([], [], [], 0.0), "names no joint"),
    "name, no list": (lambda a: a.receive_joints("boom", [0.1], [], 0.0), "give a list"),
    "names None": (lambda a: a.receive_joints(None, [0.1], [], 0.0), "give a list"),
    "number as name": (lambda a: a.receive_joints([1], [0.1], [], 0.0), "give a list"),
    "neither": (lambda a: a.receive_joints(["boom"], [], [], 0.0), "neither"),
    "neither given": (lambda a: a.receive_joints(["boom"], None, None, 0.0), "neither"),
    "both": (lambda a: a.receive_joints(["boom"], [0.1], [0.0], 0.0), "both"),
    "fewer values": (
        lambda a: a.receive_joints(["boom", "arm"], [0.1], [], 0.0),
        "2 names and 1 values",
    ),
    "more values": (
        lambda a: a.receive_joints(["boom"], [], [0.0, 0.0], 0.0),
        "1 names and 2 values",
    ),
    "joint NaN": (lambda a: a.receive_joints(["boom", "arm"], [0.1, NAN], [], 0.0), "finite"),
    "joint degrees": (
        lambda a: a.receive_joints(["boom", "arm"], [0.1, 60.0], [], 0.0),
        "arm.*units",
    ),
    "goal NaN": (lambda a: a.receive_joints(["boom"], [], [NAN], 0.0), "finite"),
    "goal beyond": (
        lambda a: a.receive_joints(["swing", "boom"], [], [0.1, 0.9], 0.0),
        "-1.05 to 0.85",
    ),
    "goal below": (lambda a: a.receive_joints(["arm"], [], [0.5], 0.0), "0.55 to 2.6"),
    "swing degrees": (lambda a: a.receive_joints(["swing"], [], [90.0], 0.0), "rad"),
    "goal of track": (
        lambda a: a.receive_joints(["left_track"], [], [1.0], 0.0),
        "a track has none",
    ),
    "few axes": (lambda a: a.receive_joy([0.0] * 5, [], 0.0), "has 5 axes and needs 6"),
    "axis NaN": (lambda a: a.receive_joy([NAN] + [0.0] * 5, [], 0.0), "finite"),
    "axis raw": (
        lambda a: a.receive_joy([0.0, 32767.0] + [0.0] * 4, [], 0.0),
        "axis 1 .joy_left_y.",
    ),
    "buttons NaN": (lambda a: a.receive_joy([0.0] * 6, [NAN], 0.0), "buttons"),
    "stop text": (lambda a: a.emergency_stop("false"), "true or false"),
    "time NaN": (lambda a: a.receive_front([0.2] * 4, NAN), "time"),
}


@pytest.mark.parametrize("name", BAD)
def test_invalid_command_is_rejected_and_the_last_valid_one_stays(make_arbiter, name):
    command, sentence = BAD[name]
    arbiter = make_arbiter()
    arbiter.receive_front([0.1] * 4, 0.0)
    arbiter.receive_tracks([0.3, 0.4], 0.0)
    with pytest.raises(CommandError, match=sentence):
        command(arbiter)
    applied = arbiter.command_at(0.0, HOME)
    assert applied.joints.tolist() == [0.1] * 4
    assert applied.tracks.tolist() == [0.3, 0.4]


def test_arrays_of_ros_messages_are_accepted(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_front(array.array("d", [0.1, 0.2, 0.3, 0.4]), 0.0)
    arbiter.receive_joints(["left_track"], array.array("d", [1.0]), array.array("d"), 0.0)
    applied = arbiter.command_at(0.0, HOME)
    assert applied.joints.tolist() == [0.1, 0.2, 0.3, 0.4]
    assert applied.tracks.tolist() == [1.0, 0.0]


def test_values_up_to_the_unit_error_factor_are_accepted(make_arbiter, spec):
    arbiter = make_arbiter(unit_error_factor=2.0)
    top = spec.joints["swing"].max_velocity
    arbiter.receive_front([2.0 * top, 0.0, 0.0, 0.0], 0.0)
    with pytest.raises(CommandError, match="2 times"):
        arbiter.receive_front([2.001 * top, 0.0, 0.0, 0.0], 0.0)


def test_target_just_beyond_a_limit_is_clipped_to_it(make_arbiter, spec):
    arbiter, upper = make_arbiter(), spec.joints["boom"].upper
    arbiter.receive_joints(["boom"], [], [upper + 0.9 * POSITION_TOLERANCE], 0.0)
    assert arbiter.command_at(0.0, (0.0, upper, 1.0, 1.0)).joints[1] == 0.0


def test_error_of_a_long_command_is_short(make_arbiter):
    with pytest.raises(CommandError) as caught:
        make_arbiter().receive_front(np.full(100_000, np.nan), 0.0)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    ("values", "text"),
    [
        (array.array("d", [0.1, NAN, -INF]), "[0.1, nan, -inf]"),
        (array.array("f", [0.1, NAN]), "[0.1, nan]"),
        (array.array("i", [0, 1]), "[0, 1]"),
        (array.array("d", [0.5] * 10), "[0.5, 0.5, 0.5, 0.5, 0.5, 0.5, ...]"),
        (array.array("d"), "[]"),
        (np.array([0.1, NAN]), "[0.1, nan]"),
    ],
)
def test_error_has_the_numbers_of_an_array_as_a_list(values, text):
    assert format_value(values) == text


STAMPED = {
    "joints": lambda a, **stamp: a.receive_joints(["boom"], [0.1], [], 50.0, **stamp),
    "twist": lambda a, **stamp: a.receive_twist(0.5, 0.0, 50.0, **stamp),
    "joy": lambda a, **stamp: a.receive_joy([0.2] * 6, [0] * 11, 50.0, **stamp),
}


@pytest.mark.parametrize("command", STAMPED.values(), ids=STAMPED)
def test_stamps_are_ignored_by_default(make_arbiter, command):
    arbiter = make_arbiter()
    for stamp in (None, 0.0, 1e9, NAN):
        command(arbiter, stamp=stamp, sim_now=10.0)


@pytest.mark.parametrize("command", STAMPED.values(), ids=STAMPED)
@pytest.mark.parametrize(
    ("stamp", "sentence"),
    [(9.5, "0.5 s old"), (10.2, "0.2 s in the future"), (None, "stamp"), (NAN, "stamp")],
)
def test_old_and_future_stamps_are_rejected_when_checked(make_arbiter, command, stamp, sentence):
    arbiter = make_arbiter(check_stamps=True)
    with pytest.raises(CommandError, match=sentence):
        command(arbiter, stamp=stamp, sim_now=10.0)
    applied = arbiter.command_at(50.0, HOME)
    assert set(applied.joint_sources + applied.track_sources) == {"none"}


@pytest.mark.parametrize("command", STAMPED.values(), ids=STAMPED)
@pytest.mark.parametrize("stamp", [9.8, 10.0, 10.01])
def test_present_stamps_are_accepted_when_checked(make_arbiter, command, stamp):
    arbiter = make_arbiter(check_stamps=True)
    command(arbiter, stamp=stamp, sim_now=10.0)
    applied = arbiter.command_at(50.0, HOME)
    assert set(applied.joint_sources + applied.track_sources) != {"none"}


def test_time_of_arrival_is_the_default_simulation_time(make_arbiter):
    arbiter = make_arbiter(check_stamps=True)
    arbiter.receive_twist(0.5, 0.0, 50.0, stamp=49.9)
    with pytest.raises(CommandError, match="old"):
        arbiter.receive_twist(0.5, 0.0, 50.0, stamp=49.0)


def test_default_parameters_are_the_shipped_ones(spec):
    assert CommandArbiter(spec).params == CommandParams()
