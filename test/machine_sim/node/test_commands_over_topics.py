"""Commands over topics: effect, rejection, timeout, emergency stop."""

from __future__ import annotations

import math
from typing import Any

import pytest
from geometry_msgs.msg import TwistStamped
from sensor_msgs.msg import JointState, Joy
from std_msgs.msg import Bool, Float64MultiArray
from support.machine_scenes import COMMAND_NAMES
from support.node_scenes import Scene
from support.stepped_machine import SteppedMachine, twist

from machine_sim.node.machine_node import MachineNode
from msg_bridge.codec.stamps import stamp_from_seconds
from msg_bridge.exchange.stream_buffers import PIPELINE_DEPTH
from msg_bridge.testing.ros_context import Ros

GAUGE = 2.38


def floats(*values: float) -> Float64MultiArray:
    return Float64MultiArray(data=list(values))


def joints(names: list[str], stamp: float = 0.0, **values: list[float]) -> JointState:
    message = JointState(name=names, **values)
    message.header.stamp = stamp_from_seconds(stamp)
    return message


FRONT = [0.1, 0.2, -0.3, 0.4]


VALID_COMMANDS = [
    ("front_velocity_controller/commands", floats(*FRONT), [*FRONT, 0, 0]),
    ("track_velocity_controller/commands", floats(0.5, -0.25), [0, 0, 0, 0, 0.5, -0.25]),
    ("joint_commands", joints(["arm", "left_track"], velocity=[0.2, 0.3]), [0, 0, 0.2, 0, 0.3, 0]),
    ("cmd_vel", twist(0.6, 0.1), [0, 0, 0, 0, 0.6 - 0.05 * GAUGE, 0.6 + 0.05 * GAUGE]),
]  # fmt: skip


@pytest.mark.parametrize(("topic", "message", "expected"), VALID_COMMANDS)
def test_command_takes_effect_in_the_next_tick(
    ros: Ros, topic: str, message: Any, expected: list[float]
) -> None:
    stepped = SteppedMachine(ros)
    stepped.send(topic, message)
    ros.spin_until(lambda: any(stepped.current_command()))
    assert stepped.step() == pytest.approx(expected)


def test_joint_moves_to_a_commanded_position(ros: Ros) -> None:
    stepped = SteppedMachine(ros)
    stepped.send("joint_commands", joints(["swing"], position=[-0.5]))
    ros.spin_until(lambda: any(stepped.current_command()))
    applied = stepped.step()
    assert applied[0] < -0.1
    assert applied[1:] == [0.0] * 5


def test_joystick_moves_joints_and_tracks(ros: Ros) -> None:
    stepped = SteppedMachine(ros)
    released, pushed = [0.0] * 6, [1.0, 0.0, 0.0, 0.0, -1.0, 0.0]
    for axes in (released, pushed):  # axes count once they have been at rest
        stepped.send("joy", Joy(axes=axes, buttons=[0] * 12))
    ros.spin_until(lambda: any(stepped.current_command()))
    applied = stepped.step()
    assert applied[0] > 0.3
    assert applied[4] > 0.3
    assert applied[1:4] == [0.0] * 3
    assert applied[5] == 0.0


def test_axis_that_was_never_at_rest_moves_nothing_and_is_reported(ros: Ros) -> None:
    stepped = SteppedMachine(ros)
    stepped.send("joy", Joy(axes=[0.0, 0.0, 1.0, 0.0, 0.0, 1.0]))  # released triggers of joy_node

    def message() -> str:
        stepped.machine.diagnostics.publish()
        return stepped.scene.shown(stepped.machine).get("message", "")

    ros.spin_until(lambda: "axis 2 (joy_right_x), axis 5 (joy_right_pedal) of joy" in message())
    assert stepped.scene.shown(stepped.machine)["level"] == "1"
    assert not any(stepped.current_command())
    stepped.send("joy", Joy(axes=[0.0] * 6))
    ros.spin_until(lambda: "joy_" not in message())


def test_machine_follows_a_velocity_command(ros: Ros) -> None:
    states = ros.collect("/excavator/joint_states", JointState)
    scene = Scene(ros)
    scene.machine(**{"commands.command_timeout": 60.0})
    scene.until_tick(1)
    publisher = ros.publisher(
        "/excavator/front_velocity_controller/commands", Float64MultiArray, subscriptions=1
    )
    publisher.publish(floats(0.5, 0.0, 0.0, 0.0))
    ros.spin_until(lambda: states[-1].position[0] > 0.2)
    assert states[-1].position[1] == pytest.approx(states[0].position[1], abs=0.02)


INVALID_COMMANDS = [
    ("front_velocity_controller/commands", floats(0.1, 0.2, 0.3), "3 values"),
    ("front_velocity_controller/commands", floats(0.1, math.nan, 0.0, 0.0), "[0.1, nan, 0.0, 0.0]"),
    ("front_velocity_controller/commands", floats(0.1, math.inf, 0.0, 0.0), "finite"),
    ("front_velocity_controller/commands", floats(0.1, 1e6, 0.0, 0.0), "check the units"),
    ("track_velocity_controller/commands", floats(), "0 values"),
    ("track_velocity_controller/commands", floats(1e9, 0.0), "check the units"),
    ("joint_commands", joints(["jaw"], velocity=[0.1]), "jaw"),
    ("joint_commands", joints(["arm", "boom"], velocity=[0.1]), "2 names and 1 values"),
    ("joint_commands", joints(["arm"], velocity=[0.1], position=[0.1]), "both"),
    ("joint_commands", joints(["arm"], position=[17.0]), "limits"),
    ("joint_commands", joints(["left_track"], position=[1.0]), "track"),
    ("joint_commands", joints([]), "names no joint"),
    ("cmd_vel", twist(math.nan, 0.0), "linear.x"),
    ("cmd_vel", twist(0.1, 1e4), "check the units"),
    ("joy", Joy(axes=[0.0] * 2), "axes"),
    ("joy", Joy(axes=[0.1, math.nan, 0.0, 0.0, 0.0, 0.0]), "[0.1, nan, 0.0"),
]


def test_rejected_command_changes_nothing_and_is_counted(ros: Ros) -> None:
    stepped = SteppedMachine(ros, **{"commands.command_timeout": 60.0})
    good = [0.1, 0.0, 0.0, 0.2, 0.3, 0.4]
    stepped.send("joint_commands", joints(list(COMMAND_NAMES), velocity=good))
    ros.spin_until(lambda: any(stepped.current_command()))
    assert stepped.step() == good
    counts: dict[str, int] = {}
    for topic, message, reason in INVALID_COMMANDS:
        counts[topic] = counts.get(topic, 0) + 1
        stepped.send(topic, message)
        stepped.scene.until_shown(stepped.machine, f"rejected {topic}", counts[topic])
        assert reason in stepped.scene.shown(stepped.machine)[f"last rejected {topic}"]
        assert stepped.current_command() == good
    assert stepped.step() == good
    shown = stepped.scene.shown(stepped.machine)
    assert shown["level"] == "1"
    assert "messages rejected on cmd_vel" in shown["message"]


@pytest.mark.parametrize(
    ("stamp", "reason"), [(0.0, "stamp"), (0.09, "s old"), (2.0, "in the future")]
)
def test_check_stamps_rejects_commands_with_invalid_or_old_stamps(
    ros: Ros, stamp: float, reason: str
) -> None:
    stepped = SteppedMachine(
        ros, **{"commands.check_stamps": True, "commands.command_timeout": 0.1}
    )
    stepped.scene.pause(False)
    stepped.scene.until_tick(30)
    stepped.scene.pause()
    stepped.until_waiting()
    for topic, message in (
        ("joint_commands", joints(["arm"], stamp, velocity=[0.1])),
        ("cmd_vel", twist(0.1, 0.0, stamp)),
    ):
        stepped.send(topic, message)
        stepped.scene.until_shown(stepped.machine, f"rejected {topic}", 1)
        assert reason in stepped.scene.shown(stepped.machine)[f"last rejected {topic}"]
    assert not any(stepped.current_command())
    run = stepped.machine.run
    assert run is not None
    stepped.send("joint_commands", joints(["arm"], run.schedulers[0].sim_time, velocity=[0.1]))
    ros.spin_until(lambda: any(stepped.current_command()))


def test_command_times_out_in_simulation_time_in_lockstep(ros: Ros) -> None:
    stepped = SteppedMachine(ros)
    stepped.send("track_velocity_controller/commands", floats(0.1, 0.1))
    ros.spin_until(lambda: any(stepped.current_command()))
    tick = stepped.scene.tick
    stepped.scene.pause(False)
    stepped.scene.until_tick(tick + 40)
    moving = [
        applied_tick
        for applied_tick, message in zip(stepped.ticks, stepped.applied, strict=True)
        if any(message.velocity)
    ]
    # It arrived after the machine's ticks in flight, and applies for 0.3 s from then on.
    first = tick + 2 + PIPELINE_DEPTH
    assert moving == list(range(first, first + 31))


def test_command_times_out_in_wall_time_in_real_time(
    ros: Ros,
) -> None:
    applied = ros.collect("/excavator/applied_commands", JointState)
    scene = Scene(ros, sync="realtime", machine_timeout=20.0)
    scene.machine(**{"commands.command_timeout": 0.15})
    scene.until_tick(1)
    publisher = ros.publisher("/excavator/cmd_vel", TwistStamped, subscriptions=1)
    publisher.publish(twist(0.4, 0.0))
    ros.spin_until(lambda: any(applied[-1].velocity))
    ros.spin_until(lambda: not any(applied[-1].velocity))
    # 15 ticks of 10 ms, and more if late ticks are computed in a burst.
    assert sum(any(message.velocity) for message in applied) <= 40


def test_emergency_stop_holds_until_released_and_commanded_again(ros: Ros) -> None:
    stepped = SteppedMachine(ros, **{"commands.command_timeout": 60.0})
    command = ("front_velocity_controller/commands", floats(0.1, 0.0, 0.0, 0.0))
    stepped.send(*command)
    ros.spin_until(lambda: any(stepped.current_command()))
    stepped.send("emergency_stop", Bool(data=True))
    stepped.scene.until_shown(stepped.machine, "emergency_stop", True)
    assert stepped.step() == [0.0] * 6
    stepped.send(*command)
    stepped.send("emergency_stop", Bool(data=False))
    stepped.scene.until_shown(stepped.machine, "emergency_stop", False)
    assert stepped.step() == [0.0] * 6
    stepped.send(*command)
    ros.spin_until(lambda: any(stepped.current_command()))
    assert stepped.step()[0] == 0.1


def test_only_the_emergency_stop_is_accepted_before_the_run(ros: Ros) -> None:
    machine: MachineNode = ros.add(MachineNode)
    front = ros.publisher("/excavator/cmd_vel", TwistStamped, subscriptions=1)
    stop = ros.publisher("/excavator/emergency_stop", Bool, subscriptions=1)
    front.publish(twist(0.1, 0.0))
    stop.publish(Bool(data=True))
    ros.spin_until(lambda: machine.instances[0].arbiter.is_stopped)
    ros.spin_until(lambda: "rejected cmd_vel" in machine.diagnostics.report().values)
    assert "once it has joined" in machine.diagnostics.report().values["last rejected cmd_vel"]
