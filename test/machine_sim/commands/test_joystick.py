"""Levers and pedals: their velocities, and which joystick messages are commands."""

from dataclasses import replace

import pytest

from machine_sim.commands import CommandArbiter, CommandParams
from msg_bridge.contract.errors import ParameterError

HOME = (0.0, -0.7, 1.85, 1.9)
LEFT_X, LEFT_Y, RIGHT_X, RIGHT_Y, LEFT_PEDAL, RIGHT_PEDAL = range(6)
LEFT_REVERSE, RIGHT_REVERSE = 9, 10
SWING, BOOM, ARM, BUCKET = range(4)


@pytest.fixture
def make_arbiter(spec):
    """Make an arbiter that has received the message of a joystick at rest."""

    def make(**params):
        arbiter = CommandArbiter(spec, CommandParams(**params))
        send(arbiter, -0.02, at_rest=arbiter.params.joy_pedal_rest)
        return arbiter

    return make


@pytest.fixture
def new_arbiter(spec):
    """Make an arbiter that has received no message."""
    return lambda **params: CommandArbiter(spec, CommandParams(**params))


def axes(at_rest=0.0, **moved):
    values = [0.0, 0.0, 0.0, 0.0, at_rest, at_rest]
    for name, value in moved.items():
        values[globals()[name.upper()]] = value
    return values


def buttons(*held):
    return [int(i in held) for i in range(21)]


def send(arbiter, now=0.0, held=(), at_rest=0.0, **moved):
    arbiter.receive_joy(axes(at_rest, **moved), buttons(*held), now)


def applied(arbiter, now=0.0):
    return arbiter.command_at(now, HOME)


@pytest.mark.parametrize(
    ("pattern", "lever", "joint", "sign"),
    [
        ("iso", "left_x", SWING, 1),  # left: swing left
        ("iso", "left_y", ARM, -1),  # forward: arm out
        ("iso", "right_x", BUCKET, 1),  # left: curl in
        ("iso", "right_y", BOOM, 1),  # forward: boom down
        ("sae", "left_x", SWING, 1),
        ("sae", "left_y", BOOM, 1),
        ("sae", "right_x", BUCKET, 1),
        ("sae", "right_y", ARM, -1),
    ],
)
@pytest.mark.parametrize("push", [1.0, -1.0])
def test_full_deflection_commands_maximum_speed(
    make_arbiter, spec, pattern, lever, joint, sign, push
):
    arbiter = make_arbiter(joy_pattern=pattern)
    send(arbiter, **{lever: push})
    tops = [limits.max_velocity for limits in spec.joints.values()]
    wanted = [0.0] * 4
    wanted[joint] = push * sign * tops[joint]
    assert applied(arbiter).joints.tolist() == pytest.approx(wanted)
    assert applied(arbiter).joint_sources == ("joy",) * 4
    assert applied(arbiter).track_sources == ("none",) * 2


def test_velocity_is_zero_in_the_deadzone_and_continuous_at_its_edge(make_arbiter, spec):
    top = spec.joints["swing"].max_velocity
    arbiter = make_arbiter(joy_deadzone=0.2)
    for push, part in [(0.6, 0.5), (0.2, 0.0), (0.201, 0.00125), (-0.6, -0.5), (1.00003, 1.0)]:
        send(arbiter, left_x=push)
        assert applied(arbiter).joints[SWING] == pytest.approx(part * top)


def test_pedals_drive_forward_and_backward_while_a_button_is_pressed(make_arbiter, spec):
    top = spec.tracks.max_speed
    arbiter = make_arbiter()
    send(arbiter, left_pedal=-1.0)
    assert applied(arbiter).tracks.tolist() == pytest.approx([top, 0.0])
    assert applied(arbiter).joint_sources == ("none",) * 4
    send(arbiter, held=[RIGHT_REVERSE], left_pedal=-0.55, right_pedal=-1.0)
    assert applied(arbiter).tracks.tolist() == pytest.approx([0.5 * top, -top])
    send(arbiter, held=[LEFT_REVERSE], left_pedal=-1.0)
    assert applied(arbiter).tracks.tolist() == pytest.approx([-top, 0.0])


def test_button_alone_commands_nothing(make_arbiter):
    arbiter = make_arbiter()
    send(arbiter, held=[LEFT_REVERSE, RIGHT_REVERSE])
    assert applied(arbiter).track_sources == ("none",) * 2


def test_joystick_without_buttons_drives_forward(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_joy(axes(left_pedal=-1.0, right_pedal=-1.0), [], 0.0)
    assert (applied(arbiter).tracks > 0.0).all()


def test_two_way_pedal_drives_both_directions(make_arbiter, spec):
    arbiter = make_arbiter(joy_pedal_full=1.0)
    send(arbiter, left_pedal=1.0, right_pedal=-1.0)
    top = spec.tracks.max_speed
    assert applied(arbiter).tracks.tolist() == pytest.approx([top, -top])


def test_trigger_never_seen_released_commands_nothing(new_arbiter, spec):
    arbiter = new_arbiter(
        joy_pedal_rest=1.0
    )  # joy_node: 1 at rest, -1 pressed, and 0 before the first touch
    send(arbiter, at_rest=0.0)
    assert applied(arbiter).tracks.tolist() == [0.0, 0.0]
    send(arbiter, at_rest=1.0)
    send(arbiter, at_rest=1.0, left_pedal=-1.0)
    assert applied(arbiter).tracks.tolist() == pytest.approx([spec.tracks.max_speed, 0.0])


def test_axis_deflected_in_the_first_message_counts_once_it_was_at_rest(new_arbiter):
    arbiter = new_arbiter()
    send(arbiter, 0.00, right_x=1.0, right_pedal=1.0)  # triggers that report 1 when released
    assert applied(arbiter, 0.00).joint_sources == ("none",) * 4
    assert applied(arbiter, 0.00).track_sources == ("none",) * 2
    assert arbiter.ignored_joystick_axes == ["axis 2 (joy_right_x)", "axis 5 (joy_right_pedal)"]
    send(arbiter, 0.02, left_x=1.0, right_x=1.0, right_pedal=1.0)
    assert applied(arbiter, 0.02).joints[SWING] > 0.0
    assert applied(arbiter, 0.02).joints[BUCKET] == 0.0
    send(arbiter, 0.04, right_x=0.2, right_pedal=1.0)  # nearly released
    assert applied(arbiter, 0.04).joints[BUCKET] == 0.0
    send(arbiter, 0.06, right_pedal=1.0)
    send(arbiter, 0.08, right_x=1.0, right_pedal=1.0)
    assert applied(arbiter, 0.08).joints[BUCKET] > 0.0
    assert arbiter.ignored_joystick_axes == ["axis 5 (joy_right_pedal)"]
    applied(arbiter, 2.0)
    assert arbiter.ignored_joystick_axes == [], "the device is silent"


def test_no_axis_is_reported_without_a_device_before_the_first_tick(new_arbiter):
    assert new_arbiter().ignored_joystick_axes == []


def test_lever_that_begins_to_move_in_the_first_message_counts(new_arbiter):
    arbiter = new_arbiter()
    send(arbiter, left_x=0.19)  # the live page is silent at rest
    assert applied(arbiter).joints[SWING] > 0.0
    assert arbiter.ignored_joystick_axes == []


def test_lever_held_while_the_device_was_lost_must_be_released_first(make_arbiter):
    arbiter = make_arbiter()
    send(arbiter, 0.0, left_x=1.0)
    assert applied(arbiter, 0.0).joints[SWING] > 0.0
    send(arbiter, 0.9, left_x=1.0)  # a short gap
    assert applied(arbiter, 0.9).joints[SWING] > 0.0
    send(arbiter, 2.0, left_x=1.0)
    assert applied(arbiter, 2.0).joint_sources == ("none",) * 4
    send(arbiter, 2.02)
    send(arbiter, 2.04, left_x=1.0)
    assert applied(arbiter, 2.04).joints[SWING] > 0.0


def test_axis_without_a_joint_is_not_reported(spec):
    spec = replace(spec, joystick_axes={"swing": ("left_x", 1.0)})
    arbiter = CommandArbiter(spec, CommandParams())
    send(arbiter, right_x=1.0)
    applied(arbiter)
    assert arbiter.ignored_joystick_axes == []


def test_joystick_without_pedals_needs_four_axes(make_arbiter):
    arbiter = make_arbiter(joy_left_pedal=-1, joy_right_pedal=-1)
    arbiter.receive_joy([1.0, 0.0, 0.0, 0.0], [], 0.0)
    assert applied(arbiter).joints[SWING] > 0.0


def test_released_joystick_overrides_no_other_source(make_arbiter):
    arbiter = make_arbiter()
    for tick in range(100):
        now = 0.01 * tick
        if tick % 5 == 0:
            arbiter.receive_front([0.2] * 4, now)
            arbiter.receive_tracks([0.5, 0.5], now)
        send(arbiter, now, left_x=0.05)  # within the deadzone
        assert applied(arbiter, now).joints.tolist() == [0.2] * 4
        assert applied(arbiter, now).tracks.tolist() == [0.5, 0.5]


def test_deflected_lever_commands_all_joints_and_no_track(make_arbiter):
    arbiter = make_arbiter()
    arbiter.receive_front([0.2] * 4, 0.0)
    arbiter.receive_tracks([0.5, 0.5], 0.0)
    send(arbiter, left_x=1.0)
    assert applied(arbiter).joints[1:].tolist() == [0.0] * 3
    assert applied(arbiter).joint_sources == ("joy",) * 4
    assert applied(arbiter).track_sources == ("tracks",) * 2


def test_released_lever_commands_zero_once(make_arbiter):
    arbiter = make_arbiter()
    send(arbiter, 0.0, left_x=1.0)
    send(arbiter, 0.05)
    assert applied(arbiter, 0.05).joints.tolist() == [0.0] * 4
    assert applied(arbiter, 0.05).joint_sources == ("joy",) * 4
    arbiter.receive_front([0.2] * 4, 0.06)
    send(arbiter, 0.1)
    assert applied(arbiter, 0.1).joints.tolist() == [0.2] * 4


def test_released_lever_stays_commanded_while_another_is_deflected(make_arbiter):
    arbiter = make_arbiter()
    send(arbiter, 0.0, left_x=1.0, left_y=1.0)
    arbiter.receive_front([0.2] * 4, 0.01)
    send(arbiter, 0.02, left_y=1.0)
    assert applied(arbiter, 0.02).joints[[SWING, BOOM, BUCKET]].tolist() == [0.0] * 3


def test_silent_joystick_times_out(make_arbiter):
    arbiter = make_arbiter()
    send(arbiter, 0.0, left_x=1.0)
    assert applied(arbiter, 0.31).joint_sources == ("none",) * 4


def test_lever_held_through_a_stop_must_be_released_first(make_arbiter):
    arbiter = make_arbiter()
    send(arbiter, 0.00, left_x=1.0)
    arbiter.emergency_stop(True)
    send(arbiter, 0.01, left_x=1.0)
    arbiter.emergency_stop(False)
    send(arbiter, 0.02, left_x=1.0)
    assert applied(arbiter, 0.02).joints.tolist() == [0.0] * 4
    send(arbiter, 0.03)
    send(arbiter, 0.04, left_x=1.0)
    assert applied(arbiter, 0.04).joints[SWING] > 0.0


def test_lever_held_through_a_stop_between_messages_must_be_released_first(make_arbiter):
    arbiter = make_arbiter()
    send(arbiter, 0.00, left_x=1.0)
    arbiter.emergency_stop(True)
    arbiter.emergency_stop(False)
    send(arbiter, 0.05, left_x=1.0)
    assert applied(arbiter, 0.05).joint_sources == ("none",) * 4


def test_lever_deflected_again_during_the_stop_must_be_released_again(make_arbiter):
    arbiter = make_arbiter()
    arbiter.emergency_stop(True)
    send(arbiter, 0.01)
    send(arbiter, 0.02, left_x=1.0)
    arbiter.emergency_stop(False)
    send(arbiter, 0.03, left_x=1.0)
    assert applied(arbiter, 0.03).joint_sources == ("none",) * 4


def test_joystick_released_during_the_stop_commands_after_it(make_arbiter):
    arbiter = make_arbiter()
    arbiter.emergency_stop(True)
    send(arbiter, 0.01)
    arbiter.emergency_stop(False)
    send(arbiter, 0.02, left_x=1.0)
    assert applied(arbiter, 0.02).joints[SWING] > 0.0


@pytest.mark.parametrize(
    ("params", "sentence"),
    [
        ({"joy_left_x": 1}, "joy_left_x, joy_left_y share an axis"),
        ({"joy_pedal_rest": 0.5, "joy_pedal_full": 0.45}, "apart"),
        ({"joy_pattern": "jcb"}, "iso, sae"),
        ({"command_timeout": 0.0}, "command_timeout"),
    ],
)
def test_invalid_joystick_parameters_are_rejected(params, sentence):
    with pytest.raises(ParameterError, match=sentence):
        CommandParams(**params)
