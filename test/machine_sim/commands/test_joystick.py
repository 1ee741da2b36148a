"""Levers and pedals: what each does, and when a joystick that sends is a joystick that commands."""

import pytest

from machine_sim.commands import CommandParams
from msg_bridge.contract.errors import ParameterError

HOME = (0.0, -0.7, 1.85, 1.9)
LEFT_X, LEFT_Y, RIGHT_X, RIGHT_Y, LEFT_PEDAL, RIGHT_PEDAL = range(6)
LEFT_REVERSE, RIGHT_REVERSE = 9, 10
SWING, BOOM, ARM, BUCKET = range(4)


def axes(at_rest=0.0, **moved):
    values = [0.0, 0.0, 0.0, 0.0, at_rest, at_rest]
    for name, value in moved.items():
        values[globals()[name.upper()]] = value
    return values


def buttons(*held):
    return [int(i in held) for i in range(21)]


def send(arbiter, now=0.0, held=(), at_rest=0.0, **moved):
    arbiter.joy(axes(at_rest, **moved), buttons(*held), now)


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
def test_lever_at_its_end_moves_its_joint_at_top_speed(
    arbiter, spec, pattern, lever, joint, sign, push
):
    b = arbiter(joy_pattern=pattern)
    send(b, **{lever: push})
    tops = [limits.max_velocity for limits in spec.joints.values()]
    wanted = [0.0] * 4
    wanted[joint] = push * sign * tops[joint]
    assert applied(b).joints.tolist() == pytest.approx(wanted)
    assert applied(b).joint_sources == ("joy",) * 4
    assert applied(b).track_sources == ("none",) * 2


def test_deadzone_is_at_rest_and_motion_starts_from_zero_at_its_edge(arbiter, spec):
    top = spec.joints["swing"].max_velocity
    b = arbiter(joy_deadzone=0.2)
    for push, part in [(0.6, 0.5), (0.2, 0.0), (0.201, 0.00125), (-0.6, -0.5), (1.00003, 1.0)]:
        send(b, left_x=push)
        assert applied(b).joints[SWING] == pytest.approx(part * top)


def test_pedals_press_forward_and_reverse_while_a_button_is_held(arbiter, spec):
    top = spec.tracks.max_speed
    b = arbiter()
    send(b, left_pedal=-1.0)
    assert applied(b).tracks.tolist() == pytest.approx([top, 0.0])
    assert applied(b).joint_sources == ("none",) * 4
    send(b, held=[RIGHT_REVERSE], left_pedal=-0.55, right_pedal=-1.0)
    assert applied(b).tracks.tolist() == pytest.approx([0.5 * top, -top])
    send(b, held=[LEFT_REVERSE], left_pedal=-1.0)
    assert applied(b).tracks.tolist() == pytest.approx([-top, 0.0])


def test_button_alone_does_not_move(arbiter):
    b = arbiter()
    send(b, held=[LEFT_REVERSE, RIGHT_REVERSE])
    assert applied(b).track_sources == ("none",) * 2


def test_joystick_without_buttons_drives_forward(arbiter):
    b = arbiter()
    b.joy(axes(left_pedal=-1.0, right_pedal=-1.0), [], 0.0)
    assert (applied(b).tracks > 0.0).all()


def test_pedal_that_rocks_drives_both_ways(arbiter, spec):
    b = arbiter(joy_pedal_full=1.0)
    send(b, left_pedal=1.0, right_pedal=-1.0)
    top = spec.tracks.max_speed
    assert applied(b).tracks.tolist() == pytest.approx([top, -top])


def test_trigger_that_was_never_touched_does_not_drive_off(arbiter, spec):
    b = arbiter(joy_pedal_rest=1.0)  # joy_node: 1 at rest, -1 pressed, and 0 before the first touch
    send(b, at_rest=0.0)
    assert applied(b).tracks.tolist() == [0.0, 0.0]
    send(b, at_rest=1.0)
    send(b, at_rest=1.0, left_pedal=-1.0)
    assert applied(b).tracks.tolist() == pytest.approx([spec.tracks.max_speed, 0.0])


def test_joystick_without_pedals_needs_four_axes(arbiter):
    b = arbiter(joy_left_pedal=-1, joy_right_pedal=-1)
    b.joy([1.0, 0.0, 0.0, 0.0], [], 0.0)
    assert applied(b).joints[SWING] > 0.0


def test_joystick_at_rest_leaves_the_machine_to_others(arbiter):
    b = arbiter()
    for tick in range(100):
        now = 0.01 * tick
        if tick % 5 == 0:
            b.front([0.2] * 4, now)
            b.tracks([0.5, 0.5], now)
        send(b, now, left_x=0.05)  # within the deadzone
        assert applied(b, now).joints.tolist() == [0.2] * 4
        assert applied(b, now).tracks.tolist() == [0.5, 0.5]


def test_moved_lever_takes_all_joints_and_leaves_the_tracks(arbiter):
    b = arbiter()
    b.front([0.2] * 4, 0.0)
    b.tracks([0.5, 0.5], 0.0)
    send(b, left_x=1.0)
    assert applied(b).joints[1:].tolist() == [0.0] * 3
    assert applied(b).joint_sources == ("joy",) * 4
    assert applied(b).track_sources == ("tracks",) * 2


def test_lever_let_go_stops_at_once_and_then_gives_up_its_claim(arbiter):
    b = arbiter()
    send(b, 0.0, left_x=1.0)
    send(b, 0.05)
    assert applied(b, 0.05).joints.tolist() == [0.0] * 4
    assert applied(b, 0.05).joint_sources == ("joy",) * 4
    b.front([0.2] * 4, 0.06)
    send(b, 0.1)
    assert applied(b, 0.1).joints.tolist() == [0.2] * 4


def test_levers_still_held_claim_those_that_are_back(arbiter):
    b = arbiter()
    send(b, 0.0, left_x=1.0, left_y=1.0)
    b.front([0.2] * 4, 0.01)
    send(b, 0.02, left_y=1.0)
    assert applied(b, 0.02).joints[[SWING, BOOM, BUCKET]].tolist() == [0.0] * 3


def test_joystick_that_falls_silent_stops(arbiter):
    b = arbiter()
    send(b, 0.0, left_x=1.0)
    assert applied(b, 0.31).joint_sources == ("none",) * 4


def test_lever_held_through_an_emergency_stop_must_come_back_first(arbiter):
    b = arbiter()
    send(b, 0.00, left_x=1.0)
    b.emergency_stop(True)
    send(b, 0.01, left_x=1.0)
    b.emergency_stop(False)
    send(b, 0.02, left_x=1.0)
    assert applied(b, 0.02).joints.tolist() == [0.0] * 4
    send(b, 0.03)
    send(b, 0.04, left_x=1.0)
    assert applied(b, 0.04).joints[SWING] > 0.0


def test_lever_held_through_a_stop_too_short_for_the_joystick_to_send_must_come_back_first(arbiter):
    b = arbiter()
    send(b, 0.00, left_x=1.0)
    b.emergency_stop(True)
    b.emergency_stop(False)
    send(b, 0.05, left_x=1.0)
    assert applied(b, 0.05).joint_sources == ("none",) * 4


def test_lever_moved_again_under_the_stop_must_come_back_again(arbiter):
    b = arbiter()
    b.emergency_stop(True)
    send(b, 0.01)
    send(b, 0.02, left_x=1.0)
    b.emergency_stop(False)
    send(b, 0.03, left_x=1.0)
    assert applied(b, 0.03).joint_sources == ("none",) * 4


def test_joystick_seen_at_rest_under_the_stop_counts_after_the_release(arbiter):
    b = arbiter()
    b.emergency_stop(True)
    send(b, 0.01)
    b.emergency_stop(False)
    send(b, 0.02, left_x=1.0)
    assert applied(b, 0.02).joints[SWING] > 0.0


@pytest.mark.parametrize(
    ("params", "sentence"),
    [
        ({"joy_left_x": 1}, "joy_left_x, joy_left_y share an axis"),
        ({"joy_pedal_rest": 0.5, "joy_pedal_full": 0.45}, "apart"),
        ({"joy_pattern": "jcb"}, "iso, sae"),
        ({"command_timeout": 0.0}, "command_timeout"),
    ],
)
def test_parameters_that_make_no_joystick_are_refused(params, sentence):
    with pytest.raises(ParameterError, match=sentence):
        CommandParams(**params)
