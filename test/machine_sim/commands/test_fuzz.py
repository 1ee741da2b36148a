"""Random sequences of valid and invalid inputs: the output is finite, invalid ones change nothing.

Two arbiters receive the same valid inputs, one of them the invalid ones, too. They never differ.
"""

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from machine_sim.commands import TRACK_NAMES, CommandArbiter, CommandError, CommandParams
from machine_sim.commands.validation import format_value
from machine_sim.machine import EXCAVATOR_JOINTS

HOME = (0.0, -0.7, 1.85, 1.9)
PARAMS = CommandParams(check_stamps=True, joy_pedal_rest=1.0)

speed = st.floats(-0.4, 0.4)
names = st.lists(st.sampled_from(EXCAVATOR_JOINTS + TRACK_NAMES), min_size=1, unique=True)
goals = {"swing": (-3.0, 3.0), "boom": (-1.0, 0.8), "arm": (0.6, 2.5), "bucket": (-0.5, 2.2)}
axis = st.sampled_from([0.0, 0.05, 1.0, -1.0, 0.5])


@st.composite
def joint_velocities(draw):
    named = draw(names)
    return "joints", (named, [draw(speed) for _ in named], None)


@st.composite
def joint_goals(draw):
    named = draw(st.lists(st.sampled_from(EXCAVATOR_JOINTS), min_size=1, unique=True))
    return "joints", (named, None, [draw(st.floats(*goals[name])) for name in named])


def calls(name, *arguments):
    return st.tuples(st.just(name), st.tuples(*arguments))


def four(value):
    return st.lists(value, min_size=4, max_size=4)


good = st.one_of(
    calls("front", four(speed)),
    calls("tracks", st.lists(speed, min_size=2, max_size=2)),
    calls("twist", speed, st.floats(-0.1, 0.1)),
    calls("joy", st.lists(axis, min_size=6, max_size=8), st.lists(st.integers(0, 1), max_size=12)),
    calls("emergency_stop", st.booleans()),
    joint_velocities(),
    joint_goals(),
)

corrupt_values = st.sampled_from([math.nan, math.inf, -math.inf, 1e9, "1", None, [0.1]])


@st.composite
def corrupt_command(draw):
    """Draw a valid command with one element replaced by an invalid or excessive one."""
    name, arguments = draw(good.filter(lambda call: call[0] != "emergency_stop"))
    spot = draw(st.sampled_from([i for i, a in enumerate(arguments) if a is not None]))
    corrupted = list(arguments)
    if name == "joints" and spot == 0:
        corrupted[0] = [*corrupted[0], draw(st.sampled_from(["bom", "", corrupted[0][0], 3]))]
    elif isinstance(corrupted[spot], list):
        values = list(corrupted[spot])
        if name == "joy":
            values = values[:6] or [0]
        values[draw(st.integers(0, len(values) - 1))] = draw(
            corrupt_values.filter(lambda bad: not (name == "joy" and spot == 1 and bad == 1e9))
        )
        corrupted[spot] = values
    else:
        corrupted[spot] = draw(corrupt_values)
    return name, tuple(corrupted)


bad = st.one_of(
    corrupt_command(),
    calls("front", st.lists(speed).filter(lambda values: len(values) != 4)),
    calls("tracks", st.lists(speed).filter(lambda values: len(values) != 2)),
    calls("joints", names, st.just([0.1] * 7), st.none()),
    calls("joints", st.just(["arm"]), st.just([0.1]), st.just([1.0])),
    calls("joints", st.just(["swing", "boom"]), st.none(), st.just([0.0, 1.5])),
    calls("joy", st.lists(axis, max_size=5), st.just([])),
    calls("emergency_stop", st.sampled_from([None, 0, 1, "true", math.nan])),
)
stale = st.one_of(joint_velocities(), joint_goals(), calls("twist", speed, speed))


def call(arbiter, name, arguments, now, stamp):
    if name == "emergency_stop":
        arbiter.emergency_stop(*arguments)
    elif name in ("front", "tracks"):
        getattr(arbiter, f"receive_{name}")(*arguments, now)
    else:
        getattr(arbiter, f"receive_{name}")(*arguments, now, stamp=stamp, sim_now=now)


def rejection_message(arbiter, name, arguments, now, stamp):
    try:
        call(arbiter, name, arguments, now, stamp)
    except CommandError as error:
        return str(error)
    return None


def same(one, other):
    return (
        one.joints.tobytes() == other.joints.tobytes()
        and one.tracks.tobytes() == other.tracks.tobytes()
        and one.joint_sources == other.joint_sources
        and one.track_sources == other.track_sources
    )


steps = st.lists(
    st.tuples(
        st.sampled_from([0.0, 0.01, 0.1, 0.35, -0.1]),
        st.one_of(
            st.tuples(st.just("good"), good),
            st.tuples(st.just("bad"), bad),
            st.tuples(st.sampled_from(["stale", "early", "unstamped"]), stale),
        ),
        st.booleans(),
    ),
    max_size=25,
)


@settings(max_examples=300, deadline=None)
@given(steps=steps)
def test_invalid_inputs_change_nothing(spec, steps):
    reference, tested = CommandArbiter(spec, PARAMS), CommandArbiter(spec, PARAMS)
    now = 0.0
    for passed, (kind, command), tick in steps:
        now += passed
        stamp = {"stale": now - 1.0, "early": now + 1.0, "unstamped": None}.get(kind, now)
        if kind == "good":
            call(reference, *command, now, stamp)
            call(tested, *command, now, stamp)
        else:
            assert rejection_message(tested, *command, now, stamp), command
        if tick:
            assert same(reference.command_at(now, HOME), tested.command_at(now, HOME))
        assert reference.is_stopped == tested.is_stopped
    assert same(reference.command_at(now, HOME), tested.command_at(now, HOME))


anything = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text() | st.binary(),
    lambda inside: st.lists(inside) | st.dictionaries(st.text(), inside),
    max_leaves=8,
)


@settings(max_examples=300, deadline=None)
@given(
    name=st.sampled_from(["front", "tracks", "joints", "twist", "joy", "emergency_stop"]),
    arguments=st.tuples(anything, anything, anything),
)
def test_any_input_is_accepted_or_raises_command_error(spec, name, arguments):
    arbiter = CommandArbiter(spec)
    count = {"joints": 3, "twist": 2, "joy": 2}.get(name, 1)
    message = rejection_message(arbiter, name, arguments[:count], 0.0, None)
    assert message is None or 20 < len(message) < 400
    applied = arbiter.command_at(0.0, HOME)
    assert np.isfinite(applied.joints).all()
    assert np.isfinite(applied.tracks).all()


def test_nested_value_is_shortened():
    value = {"a" * 30: {"b" * 30: {"c" * 30: ["d" * 30] * 9}, "e" * 30: ["f" * 30] * 9}}
    assert len(format_value(value)) <= 160
    assert format_value([1.0, 2.0]) == "[1.0, 2.0]"
