"""Publications of the machine node: frames, rates, sensors, diagnostics, QoS."""

from __future__ import annotations

import math
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml
from geometry_msgs.msg import TransformStamped, WrenchStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu, JointState, PointCloud2
from std_msgs.msg import Float64MultiArray, String
from support.machine_scenes import COMMAND_NAMES
from support.node_scenes import TICK, Scene
from support.stepped_machine import SteppedMachine
from visualization_msgs.msg import MarkerArray

from machine_sim.physics_engine import pybullet
from msg_bridge.codec import qos
from msg_bridge.codec.machine_state import BASE_JOINTS, from_payload_array, from_track_array
from msg_bridge.codec.run_config import parse_run_facts
from msg_bridge.codec.stamps import tick_from_stamp
from msg_bridge.nodes.diagnostics import Level
from msg_bridge.testing.ros_context import Ros

PUBLISHED = {
    "soil_tick": qos.ROWS,
    "/soil/tool_sweeps": qos.ROWS,
    "/soil/deposit_requests": qos.ROWS,
    "applied_commands": qos.ROWS,
    "joint_states": qos.STATE,
    "odom": qos.STATE,
    "payload": qos.STATE,
    "cylinders": qos.STATE,
    "tracks": qos.STATE,
    "imu/base/data": qos.STATE,
    "imu/upper/data": qos.STATE,
    "joint_states_measured": qos.STATE,
    "bucket/wrench": qos.STATE,
    "particles": qos.STATE,
    "transforms": qos.ROWS,
    "markers": qos.STATE,
    "state_hash": qos.STATE,
    "robot_description": qos.TRANSIENT_LOCAL,
    "config": qos.TRANSIENT_LOCAL,
}


SUBSCRIBED = {
    "front_velocity_controller/commands": qos.COMMANDS,
    "track_velocity_controller/commands": qos.COMMANDS,
    "joint_commands": qos.COMMANDS,
    "cmd_vel": qos.COMMANDS,
    "joy": qos.COMMANDS,
    "/sim/config": qos.TRANSIENT_LOCAL,
    "/terrain/map": qos.TRANSIENT_LOCAL,
    "/soil/tick": qos.ROWS,
}


NAMES = ["swing", "boom", "arm", "bucket"]


def test_late_subscriber_gets_description_and_configuration(ros: Ros) -> None:
    scene = Scene(ros, tick_period=0.02)
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
    assert content["stepping"]["steps_per_tick"] == 4
    assert parse_run_facts(config[0].data).run_id == scene.soil.run.endpoint.exchange.run_id


def test_transforms_lead_to_every_visible_link_of_the_description(ros: Ros) -> None:
    description = ros.collect("/excavator/robot_description", String, qos.TRANSIENT_LOCAL)
    transforms = ros.collect("/excavator/transforms", TransformStamped, qos.ROWS)
    scene = Scene(ros)
    scene.machine("/excavator")
    ros.spin_until(lambda: description)
    links = ElementTree.fromstring(description[0].data).findall("link")
    visible = {link.get("name") for link in links if link.find("visual") is not None}
    ros.spin_until(lambda: visible <= {m.child_frame_id for m in transforms}, what=str(visible))


def test_joint_states_have_every_free_joint_of_the_description(ros: Ros) -> None:
    description = ros.collect("/excavator/robot_description", String, qos.TRANSIENT_LOCAL)
    states = ros.collect("/excavator/joint_states", JointState, qos.STATE)
    scene = Scene(ros)
    scene.machine("/excavator")
    ros.spin_until(lambda: description and states)
    joints = ElementTree.fromstring(description[0].data).findall("joint")
    free = {j.get("name") for j in joints if j.get("type") != "fixed" and j.find("mimic") is None}
    assert free == set(states[0].name)
    assert {"left_sprocket", "right_sprocket"} <= free


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
    assert {m.header.frame_id for m in received["transforms"]} == {"map"}
    assert all(m.child_frame_id.startswith(prefix) for m in received["transforms"])
    assert received["bucket/wrench"][0].header.frame_id == f"{prefix}bucket"
    assert received["particles"][0].header.frame_id == "map"
    assert {marker.header.frame_id for marker in received["markers"][0].markers} == {"map"}
    assert from_payload_array(received["payload"][0]).bank_m3 == 0.0


def test_overturned_machine_is_reported(ros: Ros) -> None:
    stepped = SteppedMachine(ros)
    node, machine = stepped.machine, stepped.machine.run.sim.machine
    stepped.scene.until_shown(node, "overturned", False)
    assert float(stepped.scene.shown(node)["tilt_rad"]) < 0.02
    on_its_side = pybullet.getQuaternionFromEuler((0.5 * math.pi, 0.0, 0.0))
    pybullet.resetBasePositionAndOrientation(
        machine.body, [0.0, 0.0, 1.5], on_its_side, machine.client_id
    )
    machine.after_step()
    stepped.scene.until_shown(node, "overturned", True)
    assert float(stepped.scene.shown(node)["tilt_rad"]) == pytest.approx(0.5 * math.pi, abs=1e-3)
    assert "overturned" in node.diagnostics.report().message


def test_machine_beyond_the_edge_of_the_map_is_reported(ros: Ros) -> None:
    stepped = SteppedMachine(ros)
    node, machine = stepped.machine, stepped.machine.run.sim.machine
    stepped.scene.until_shown(node, "beyond_map", "")
    assert "beyond the edge" not in node.diagnostics.report().message
    edge = 0.5 * node.run.sim.ground.grid.size[0]
    for x, expected in ((edge - 0.5, "bucket"), (edge + 0.5, "base, bucket"), (0.0, "")):
        pose = ([x, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])
        pybullet.resetBasePositionAndOrientation(machine.body, *pose, machine.client_id)
        machine.after_step()
        stepped.scene.until_shown(node, "beyond_map", expected)
        report = node.diagnostics.report()
        is_reported = "bucket of the machine" in report.message and report.level is Level.WARN
        assert is_reported == bool(expected)
        assert ("base of the machine" in report.message) == ("base" in expected)


def test_track_off_its_wheels_is_reported_for_a_while(
    ros: Ros, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("machine_sim.node.machine_diagnostics._TRACK_WARN_TIME", 1.0)
    stepped = SteppedMachine(ros)
    node = stepped.machine
    stepped.scene.until_shown(node, "tracks_off_wheels", 0)
    assert "track" not in node.diagnostics.report().message
    node.run.sim.machine.tracks.num_reseats[1] += 1
    stepped.scene.until_shown(node, "tracks_off_wheels", 1)
    assert "come off its wheels" in node.diagnostics.report().message
    stepped.scene.until_shown(node, "message", "ok")
    assert stepped.scene.shown(node)["tracks_off_wheels"] == "1"


def test_tracks_publish_slip_and_sinkage(ros: Ros) -> None:
    tracks = ros.collect("/excavator/tracks", Float64MultiArray, qos.STATE)
    Scene(ros).machine()
    ros.spin_until(lambda: len(tracks) >= 5)
    left, right, time = from_track_array(tracks[-1])
    assert left.slip == right.slip == left.speed_m_s == 0.0
    assert left.sinkage_m > 0.0  # it stands
    assert time == pytest.approx(round(time / TICK) * TICK)


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


def test_published_efforts_are_the_mean_over_the_steps_of_a_tick(ros: Ros) -> None:
    states = ros.collect("/excavator/joint_states", JointState, qos.STATE)
    scene = Scene(ros)
    node = scene.machine(state_rate=1.0 / TICK)
    scene.until_tick(3)
    scene.pause()
    ros.spin_until(
        lambda: states and tick_from_stamp(states[-1].header.stamp, TICK) == node.run.tick
    )
    (simulated,) = node.run.sim.simulated_machines
    efforts = dict(zip(states[-1].name, states[-1].effort, strict=True))
    assert [efforts[name] for name in NAMES] == simulated.joint_efforts.tolist()
    assert simulated.joint_efforts.tolist() != simulated.machine.joint_efforts.tolist()
    sprockets = [efforts["left_sprocket"], efforts["right_sprocket"]]
    radius = simulated.machine.spec.tracks.sprocket_radius
    assert sprockets == (radius * simulated.drive_forces).tolist()


def test_each_topic_has_its_qos_profile(ros: Ros) -> None:
    machine = Scene(ros).machine()

    def check(expected: dict[str, Any], endpoints: Any) -> None:
        profiles = {each.topic_name: each.qos_profile for each in endpoints}
        for topic, profile in expected.items():
            own = profiles[topic if topic.startswith("/") else f"/excavator/{topic}"]
            assert (own.depth, own.reliability, own.durability, own.history) == (
                profile.depth,
                profile.reliability,
                profile.durability,
                profile.history,
            ), topic

    check(PUBLISHED, machine.publishers)
    check(SUBSCRIBED, machine.subscriptions)
