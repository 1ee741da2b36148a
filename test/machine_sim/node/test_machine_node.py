"""Machine node: publications, commands, parameters, joining and leaving."""

from __future__ import annotations

import math
import signal
import sys
from typing import Any

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TransformStamped, TwistStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import Imu, JointState, Joy, PointCloud2
from std_msgs.msg import Bool, Float64MultiArray, String
from support.machine_scenes import COMMAND_NAMES
from support.node_scenes import SITE, TICK, Scene
from visualization_msgs.msg import MarkerArray

from dig_operator.node import DigOperatorNode
from machine_sim.node.machine_node import MachineNode
from machine_sim.physics_engine import pybullet
from msg_bridge.codec import qos
from msg_bridge.codec.machine_state import (
    BASE_JOINTS,
    from_command_state,
    from_payload_array,
)
from msg_bridge.codec.run_config import parse_run_facts
from msg_bridge.codec.stamps import stamp_from_seconds, tick_from_stamp
from msg_bridge.config_files import ConfigError
from msg_bridge.contract.errors import ParameterError
from msg_bridge.exchange.stream_buffers import PIPELINE_DEPTH
from msg_bridge.testing.fixtures import StartProcess
from msg_bridge.testing.ros_context import Ros

PROFILES = {
    "soil_tick": qos.ROWS,
    "/soil/tool_sweeps": qos.ROWS,
    "/soil/deposit_requests": qos.ROWS,
    "applied_commands": qos.STATE,
    "joint_states": qos.STATE,
    "odom": qos.STATE,
    "payload": qos.STATE,
    "cylinders": qos.STATE,
    "imu/base/data": qos.STATE,
    "imu/upper/data": qos.STATE,
    "joint_states_measured": qos.STATE,
    "bucket/wrench": qos.STATE,
    "particles": qos.STATE,
    "transforms": qos.STATE,
    "markers": qos.STATE,
    "state_hash": qos.STATE,
    "robot_description": qos.TRANSIENT_LOCAL,
    "config": qos.TRANSIENT_LOCAL,
}
RECEIVED = {
    "front_velocity_controller/commands": qos.COMMANDS,
    "track_velocity_controller/commands": qos.COMMANDS,
    "joint_commands": qos.COMMANDS,
    "cmd_vel": qos.COMMANDS,
    "joy": qos.COMMANDS,
    "emergency_stop": qos.STATE,
    "/sim/config": qos.TRANSIENT_LOCAL,
    "/terrain/map": qos.TRANSIENT_LOCAL,
    "/soil/tick": qos.ROWS,
}
NAMES = ["swing", "boom", "arm", "bucket"]
GAUGE = 2.38


def floats(*values: float) -> Float64MultiArray:
    return Float64MultiArray(data=list(values))


def joints(names: list[str], stamp: float = 0.0, **values: list[float]) -> JointState:
    message = JointState(name=names, **values)
    message.header.stamp = stamp_from_seconds(stamp)
    return message


def twist(linear: float, angular: float, stamp: float = 0.0) -> TwistStamped:
    message = TwistStamped()
    message.header.stamp = stamp_from_seconds(stamp)
    message.twist.linear.x, message.twist.angular.z = linear, angular
    return message


class Levers:
    """A machine in lockstep whose soil stands still after tick 1, and its levers."""

    def __init__(self, ros: Ros, **parameters: Any) -> None:
        self.applied = ros.collect("/excavator/applied_commands", JointState)
        self.scene = Scene(ros, paused=True)
        self.machine = self.scene.machine(**parameters)
        ros.spin_until(lambda: self.scene.tick == 0)
        self.scene.step()
        self.ros = ros
        self.until_still()

    def until_still(self) -> None:
        """Until the machine has done all that it can without the soil's next tick."""
        last = self.scene.tick + 1 + PIPELINE_DEPTH
        self.ros.spin_until(lambda: self.machine.run is not None and self.machine.run.tick == last)

    def send(self, topic: str, message: Any) -> None:
        """Publish a command to its subscription."""
        publisher = self.ros.publisher(f"/excavator/{topic}", type(message), subscriptions=1)
        publisher.publish(message)

    def in_force(self) -> list[float]:
        """What the machine would do now."""
        run = self.machine.run
        assert run is not None
        cab = run.schedulers[0]
        now = cab.arbiter.command_at(cab.sim_time, run.sim.machine.joint_positions)
        return [*now.joints.tolist(), *now.tracks.tolist()]

    def step(self) -> list[float]:
        """One tick of the soil; what the machine applies in the tick that it can do then."""
        self.scene.step()
        wanted = self.scene.tick + 1 + PIPELINE_DEPTH
        self.ros.spin_until(lambda: self.applied and self.ticks[-1] >= wanted)
        assert self.ticks[-1] == wanted
        return from_command_state(self.applied[-1], COMMAND_NAMES).tolist()

    @property
    def ticks(self) -> list[int]:
        return [tick_from_stamp(message.header.stamp, TICK) for message in self.applied]


# Publications.


def test_late_subscriber_gets_description_and_configuration(ros: Ros) -> None:
    scene = Scene(ros)
    scene.machine(**{"commands.command_timeout": 0.7})
    scene.until_tick(3)
    urdf = ros.collect("/excavator/robot_description", String, qos.TRANSIENT_LOCAL)
    config = ros.collect("/excavator/config", String, qos.TRANSIENT_LOCAL)
    ros.spin_until(lambda: urdf and config)
    assert urdf[0].data.lstrip().startswith("<")
    assert '"excavator/base_link"' in urdf[0].data
    content = yaml.safe_load(config[0].data)
    assert content["commands"]["command_timeout"] == 0.7
    assert content["machine_sim"]["machine_id"] == 1
    assert parse_run_facts(config[0].data).run_id == scene.soil.run.endpoint.exchange.run_id


@pytest.mark.parametrize(
    ("namespace", "options", "prefix"),
    [
        ("/excavator", {}, "excavator/"),
        ("/digger", {}, "digger/"),
        ("/excavator", {"frame_prefix": "ex_"}, "ex_"),
    ],
)
def test_frames_are_prefixed_and_relative_to_the_map(
    ros: Ros, namespace: str, options: dict[str, str], prefix: str
) -> None:
    received = {
        topic: ros.collect(f"{namespace}/{topic}", of, qos.STATE)
        for topic, of in {
            "odom": Odometry,
            "bucket/wrench": WrenchStamped,
            "transforms": TransformStamped,
            "particles": PointCloud2,
            "markers": MarkerArray,
            "payload": Float64MultiArray,
        }.items()
    }
    scene = Scene(ros)
    scene.machine(namespace, **options)
    ros.spin_until(lambda: all(received.values()) and len(received["transforms"]) >= 5)
    odom = received["odom"][0]
    assert (odom.header.frame_id, odom.child_frame_id) == ("map", f"{prefix}base_link")
    frames = {(m.header.frame_id, m.child_frame_id) for m in received["transforms"]}
    assert len(frames) == 5
    assert {parent for parent, _ in frames} == {"map"}
    assert all(child.startswith(prefix) for _, child in frames)
    assert received["bucket/wrench"][0].header.frame_id in {child for _, child in frames}
    assert received["particles"][0].header.frame_id == "map"
    assert {marker.header.frame_id for marker in received["markers"][0].markers} == {"map"}
    assert from_payload_array(received["payload"][0]).bank_m3 == 0.0


def test_overturned_machine_is_reported(ros: Ros) -> None:
    levers = Levers(ros)
    node, machine = levers.machine, levers.machine.run.sim.machine
    levers.scene.until_shown(node, "overturned", False)
    assert float(levers.scene.shown(node)["tilt_rad"]) < 0.02
    on_its_side = pybullet.getQuaternionFromEuler((0.5 * math.pi, 0.0, 0.0))
    pybullet.resetBasePositionAndOrientation(
        machine.body, [0.0, 0.0, 1.5], on_its_side, machine.client_id
    )
    machine.after_step()
    levers.scene.until_shown(node, "overturned", True)
    assert float(levers.scene.shown(node)["tilt_rad"]) == pytest.approx(0.5 * math.pi, abs=1e-3)
    assert "overturned" in node.diagnostics.report().message


def test_sensors_are_published_with_frames_and_delay(ros: Ros) -> None:
    imus = {
        name: ros.collect(f"/excavator/imu/{name}/data", Imu, qos.STATE)
        for name in ("base", "upper")
    }
    encoders = ros.collect("/excavator/joint_states_measured", JointState, qos.STATE)
    scene = Scene(ros)
    scene.machine("/excavator", **{"sensors.encoder_delay": 0.04, "sensors.rate": 100.0})
    ros.spin_until(lambda: len(encoders) > 12 and all(imus.values()))
    assert imus["base"][0].header.frame_id == "excavator/base_link"
    assert imus["upper"][0].header.frame_id == "excavator/upper"
    assert imus["upper"][0].linear_acceleration.z == pytest.approx(9.81, abs=0.5)
    assert list(encoders[-1].name) == list(NAMES)
    tick = tick_from_stamp(imus["base"][-1].header.stamp, TICK)
    assert tick - tick_from_stamp(encoders[-1].header.stamp, TICK) in range(2, 7)


def test_states_are_published_at_their_rates_and_applied_commands_each_tick(ros: Ros) -> None:
    states = ros.collect("/excavator/joint_states", JointState)
    applied = ros.collect("/excavator/applied_commands", JointState)
    scene = Scene(ros)
    scene.machine(state_rate=25.0)
    scene.until_tick(40)
    ticks = [tick_from_stamp(message.header.stamp, TICK) for message in states]
    assert all(tick % 4 == 0 for tick in ticks)
    assert set(ticks) >= set(range(8, 37, 4))
    ticks = [tick_from_stamp(message.header.stamp, TICK) for message in applied]
    assert ticks == list(range(ticks[0], ticks[0] + len(ticks)))
    assert list(applied[0].name) == list(COMMAND_NAMES)
    names = list(states[0].name)
    assert names[:4] == list(NAMES)
    assert names[-6:] == list(BASE_JOINTS)
    assert {"boom_rod_left_stroke", "bucket_rocker_pin"} < set(names[4:-6])


def test_each_topic_has_its_qos_profile(ros: Ros) -> None:
    machine = Scene(ros).machine()

    def check(wanted: dict[str, Any], endpoints: Any) -> None:
        found = {each.topic_name: each.qos_profile for each in endpoints}
        for topic, profile in wanted.items():
            own = found[topic if topic.startswith("/") else f"/excavator/{topic}"]
            assert (own.depth, own.reliability, own.durability, own.history) == (
                profile.depth,
                profile.reliability,
                profile.durability,
                profile.history,
            ), topic

    check(PROFILES, machine.publishers)
    check(RECEIVED, machine.subscriptions)


@pytest.mark.parametrize("node_class", [MachineNode, DigOperatorNode])
def test_each_parameter_has_a_description_and_a_range(ros: Ros, node_class: Any) -> None:
    node: Node = ros.add(node_class)
    names = [n for n in node.list_parameters([], 0).names if n != "use_sim_time"]
    names = [n for n in names if not n.startswith(("qos_overrides", "start_type_description"))]
    assert len(names) > 5
    for descriptor in node.describe_parameters(names):
        assert len(descriptor.description) > 4, descriptor.name
        value = node.get_parameter(descriptor.name).value
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            assert [*descriptor.floating_point_range, *descriptor.integer_range], descriptor.name


def test_invalid_parameters_are_rejected(ros: Ros) -> None:
    scene = Scene(ros)
    with pytest.raises(ParameterError, match=r"machine_it.*machine_id"):
        scene.machine(machine_it=2)
    with pytest.raises(ConfigError, match="nothing"):
        scene.machine(machine="nothing.yaml")


def test_tick_period_that_is_no_multiple_of_the_step_ends_the_node(ros: Ros) -> None:
    scene = Scene(ros, tick_period=0.012)
    scene.machine()
    with pytest.raises(ParameterError, match="physics_step"):
        scene.until_tick(0)


# Commands.

FRONT = [0.1, 0.2, -0.3, 0.4]
MOVED = [
    ("front_velocity_controller/commands", floats(*FRONT), [*FRONT, 0, 0]),
    ("track_velocity_controller/commands", floats(0.5, -0.25), [0, 0, 0, 0, 0.5, -0.25]),
    ("joint_commands", joints(["arm", "left_track"], velocity=[0.2, 0.3]), [0, 0, 0.2, 0, 0.3, 0]),
    ("cmd_vel", twist(0.6, 0.1), [0, 0, 0, 0, 0.6 - 0.05 * GAUGE, 0.6 + 0.05 * GAUGE]),
]  # fmt: skip


@pytest.mark.parametrize(("topic", "message", "wanted"), MOVED)
def test_command_takes_effect_in_the_next_tick(
    ros: Ros, topic: str, message: Any, wanted: list[float]
) -> None:
    levers = Levers(ros)
    levers.send(topic, message)
    ros.spin_until(lambda: any(levers.in_force()))
    assert levers.step() == pytest.approx(wanted)


def test_joint_moves_to_a_commanded_position(ros: Ros) -> None:
    levers = Levers(ros)
    levers.send("joint_commands", joints(["swing"], position=[-0.5]))
    ros.spin_until(lambda: any(levers.in_force()))
    applied = levers.step()
    assert applied[0] < -0.1
    assert applied[1:] == [0.0] * 5


def test_a_joystick_moves_joints_and_tracks(ros: Ros) -> None:
    levers = Levers(ros)
    rest, pushed = [0.0] * 6, [1.0, 0.0, 0.0, 0.0, -1.0, 0.0]
    for axes in (rest, pushed):  # pedals count once they were seen at rest
        levers.send("joy", Joy(axes=axes, buttons=[0] * 12))
    ros.spin_until(lambda: any(levers.in_force()))
    applied = levers.step()
    assert applied[0] > 0.3
    assert applied[4] > 0.3
    assert applied[1:4] == [0.0] * 3
    assert applied[5] == 0.0


def test_cmd_vel_moves_the_machine(ros: Ros) -> None:
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


REFUSED = [
    ("front_velocity_controller/commands", floats(0.1, 0.2, 0.3), "3 values"),
    ("front_velocity_controller/commands", floats(0.1, math.nan, 0.0, 0.0), "finite"),
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
    ("joy", Joy(axes=[0.0, math.nan, 0.0, 0.0, 0.0, 0.0]), "finite"),
]


def test_rejected_command_changes_nothing_and_is_counted(ros: Ros) -> None:
    levers = Levers(ros, **{"commands.command_timeout": 60.0})
    good = [0.1, 0.0, 0.0, 0.2, 0.3, 0.4]
    levers.send("joint_commands", joints(list(COMMAND_NAMES), velocity=good))
    ros.spin_until(lambda: any(levers.in_force()))
    assert levers.step() == good
    counts: dict[str, int] = {}
    for topic, message, reason in REFUSED:
        counts[topic] = counts.get(topic, 0) + 1
        levers.send(topic, message)
        levers.scene.until_shown(levers.machine, f"rejected {topic}", counts[topic])
        assert reason in levers.scene.shown(levers.machine)[f"last rejected {topic}"]
        assert levers.in_force() == good
    assert levers.step() == good
    shown = levers.scene.shown(levers.machine)
    assert shown["level"] == "1"
    assert "messages rejected on cmd_vel" in shown["message"]


@pytest.mark.parametrize(
    ("stamp", "reason"), [(0.0, "stamp"), (0.09, "s old"), (2.0, "in the future")]
)
def test_with_check_stamps_an_old_command_is_rejected(ros: Ros, stamp: float, reason: str) -> None:
    levers = Levers(ros, **{"commands.check_stamps": True, "commands.command_timeout": 0.1})
    levers.scene.pause(False)
    levers.scene.until_tick(30)
    levers.scene.pause()
    levers.until_still()
    for topic, message in (
        ("joint_commands", joints(["arm"], stamp, velocity=[0.1])),
        ("cmd_vel", twist(0.1, 0.0, stamp)),
    ):
        levers.send(topic, message)
        levers.scene.until_shown(levers.machine, f"rejected {topic}", 1)
        assert reason in levers.scene.shown(levers.machine)[f"last rejected {topic}"]
    assert not any(levers.in_force())
    run = levers.machine.run
    assert run is not None
    levers.send("joint_commands", joints(["arm"], run.schedulers[0].sim_time, velocity=[0.1]))
    ros.spin_until(lambda: any(levers.in_force()))


def test_command_times_out_in_simulation_time_in_lockstep(ros: Ros) -> None:
    levers = Levers(ros)
    levers.send("track_velocity_controller/commands", floats(0.1, 0.1))
    ros.spin_until(lambda: any(levers.in_force()))
    came = levers.scene.tick
    levers.scene.pause(False)
    levers.scene.until_tick(came + 40)
    moved = [
        tick
        for tick, message in zip(levers.ticks, levers.applied, strict=True)
        if any(message.velocity)
    ]
    # It came when the machine had done the ticks that it is ahead, and has 0.3 s from then on.
    first = came + 2 + PIPELINE_DEPTH
    assert moved == list(range(first, first + 31))


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
    # 15 ticks of 10 ms; more where ticks that were late are caught up with.
    assert sum(any(message.velocity) for message in applied) <= 40


def test_emergency_stop_holds_until_released_and_commanded_again(ros: Ros) -> None:
    levers = Levers(ros, **{"commands.command_timeout": 60.0})
    command = ("front_velocity_controller/commands", floats(0.1, 0.0, 0.0, 0.0))
    levers.send(*command)
    ros.spin_until(lambda: any(levers.in_force()))
    levers.send("emergency_stop", Bool(data=True))
    levers.scene.until_shown(levers.machine, "emergency_stop", True)
    assert levers.step() == [0.0] * 6
    levers.send(*command)
    levers.send("emergency_stop", Bool(data=False))
    levers.scene.until_shown(levers.machine, "emergency_stop", False)
    assert levers.step() == [0.0] * 6
    levers.send(*command)
    ros.spin_until(lambda: any(levers.in_force()))
    assert levers.step()[0] == 0.1


def test_before_a_run_only_the_emergency_stop_is_accepted(ros: Ros) -> None:
    machine: MachineNode = ros.add(MachineNode)
    front = ros.publisher("/excavator/cmd_vel", TwistStamped, subscriptions=1)
    stop = ros.publisher("/excavator/emergency_stop", Bool, subscriptions=1)
    front.publish(twist(0.1, 0.0))
    stop.publish(Bool(data=True))
    ros.spin_until(lambda: machine.instances[0].arbiter.is_stopped)
    ros.spin_until(lambda: "rejected cmd_vel" in machine.diagnostics.report().values)
    assert "once it has joined" in machine.diagnostics.report().values["last rejected cmd_vel"]


# How it comes and goes.


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_machine_operator_and_soil_cleanly(
    ros: Ros, ros_process: StartProcess, number: int
) -> None:
    python = sys.executable
    soil = ros_process(
        [python, "-m", "soil_sim.node.soil_node"], parameters={**SITE, "sync": "lockstep"}
    )
    machine = ros_process([python, "-m", "machine_sim.node.machine_node"])
    operator = ros_process([python, "-m", "dig_operator.node"])
    commands = ros.collect("/excavator/joint_commands", JointState)
    reports = ros.collect("/diagnostics", DiagnosticArray, qos.STATE)
    ros.spin_until(lambda: commands)
    assert operator.stop(number) == 0
    assert machine.stop(number) == 0

    def machines() -> str:
        for array in reversed(reports):
            for status in array.status:
                if status.name.startswith("soil_sim"):
                    return {v.key: v.value for v in status.values}.get("machines", "")
        return ""

    # No machine is left that could be late: one that left is not silent.
    ros.spin_until(lambda: machines() == "none")
    assert soil.stop(number) == 0
    assert "silent" not in soil.output


def test_leaving_machine_transfers_its_account_and_is_not_dropped(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    scene = Scene(ros, machine_timeout=0.2)
    machine = scene.machine()
    scene.until_tick(5)
    scene.leave(machine)
    assert scene.joined == ()
    ros.spin_for(0.6)
    assert "silent" not in capfd.readouterr().err
    assert scene.ledgers[-1].absent == 0


def test_reset_restores_the_initial_pose_and_clears_commands(ros: Ros) -> None:
    scene = Scene(ros)
    machine = scene.machine(**{"commands.command_timeout": 60.0})
    scene.until_tick(1)
    publisher = ros.publisher("/excavator/cmd_vel", TwistStamped, subscriptions=1)
    publisher.publish(twist(1.0, 0.0))
    first = machine.run
    assert first is not None
    ros.spin_until(lambda: first.sim.machine.base_pose[0][0] > 0.3)
    assert scene.trigger("/sim/reset").success
    ros.spin_until(lambda: machine.run is not first)
    scene.until_tick(30)
    run = machine.run
    assert run is not None
    assert run.facts.run_id == scene.soil.run.endpoint.exchange.run_id
    assert np.abs(run.sim.machine.base_pose[0][:2]).max() < 0.05
    assert scene.joined == (1,)
