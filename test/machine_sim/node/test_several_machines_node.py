"""Several machines of several kinds: in one node, and in nodes of their own."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import TransformStamped, WrenchStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu, JointState, PointCloud2
from std_msgs.msg import Bool, Float64MultiArray, String
from support.machine_scenes import COMMAND_NAMES
from support.node_scenes import Scene, dig, machine_file, ready_to_dig
from visualization_msgs.msg import MarkerArray

from machine_sim.node.machine_node import MachineNode
from msg_bridge.codec import qos
from msg_bridge.codec.machine_state import BASE_JOINTS, from_payload_array
from msg_bridge.config_files import find_config
from msg_bridge.contract.errors import ParameterError
from msg_bridge.testing.ros_context import Ros

URDFS = ("digger/robot_description", "truck/robot_description")
PROFILES = dict.fromkeys(("config", *URDFS), qos.TRANSIENT_LOCAL)
PROFILES |= dict.fromkeys(("digger/transforms", "truck/transforms"), qos.ROWS)
DUMPER, ROAD_HEADER = "machines/dumper.yaml", "machines/road_header.yaml"


def digger_and_truck(scene: Scene, **parameters: Any) -> MachineNode:
    """Start a node in `/site` with an excavator and a dumper beside it."""
    given = {
        "machines": ["digger", "truck"],
        "truck.machine": DUMPER,
        "truck.y": 6.0,
        "commands.command_timeout": 60.0,
        **parameters,
    }
    return scene.machine("/site", **given)


def balanced(scene: Scene) -> bool:
    return {ledger.imbalance for ledger in scene.ledgers} == {0}


def own_joints(state: JointState) -> dict[str, float]:
    """Return the angles of the actuated joints of a machine."""
    pairs = zip(state.name, state.position, strict=True)
    return {n: p for n, p in pairs if not n.endswith(("_pin", "_stroke", "_sprocket"))}


def test_each_machine_publishes_in_its_namespace(ros: Ros) -> None:
    scene = Scene(ros)
    received = {
        topic: ros.collect(f"/site/{topic}", of, PROFILES.get(topic, qos.STATE))
        for topic, of in {
            "digger/joint_states": JointState,
            "digger/applied_commands": JointState,
            "digger/joint_states_measured": JointState,
            "digger/odom": Odometry,
            "digger/payload": Float64MultiArray,
            "digger/bucket/wrench": WrenchStamped,
            "digger/transforms": TransformStamped,
            "digger/imu/upper/data": Imu,
            "digger/robot_description": String,
            "truck/joint_states": JointState,
            "truck/applied_commands": JointState,
            "truck/joint_states_measured": JointState,
            "truck/odom": Odometry,
            "truck/payload": Float64MultiArray,
            "truck/bed/wrench": WrenchStamped,
            "truck/transforms": TransformStamped,
            "truck/imu/base/data": Imu,
            "truck/cylinders": Float64MultiArray,
            "truck/robot_description": String,
            "particles": PointCloud2,
            "state_hash": String,
            "config": String,
        }.items()
    }
    node = digger_and_truck(scene)
    ros.spin_until(lambda: all(received.values()))
    scene.until_tick(5)
    assert scene.joined == (1,)
    digger, truck = (
        own_joints(received[f"{name}/joint_states"][0]) for name in ("digger", "truck")
    )
    assert list(digger) == ["swing", "boom", "arm", "bucket", *BASE_JOINTS]
    assert list(truck) == ["bed", *BASE_JOINTS]
    assert (digger["base_y"], truck["base_y"]) == pytest.approx((0.0, 6.0), abs=0.01)
    assert list(received["digger/applied_commands"][0].name) == list(COMMAND_NAMES)
    assert list(received["truck/applied_commands"][0].name) == ["bed", "left_track", "right_track"]
    assert list(received["truck/joint_states_measured"][0].name) == ["bed"]
    assert received["truck/cylinders"][0].layout.dim[0].label.startswith("bed_length_m,")
    assert from_payload_array(received["truck/payload"][0]).bank_m3 == 0.0
    assert received["digger/odom"][0].child_frame_id == "digger/base_link"
    assert received["truck/odom"][0].child_frame_id == "truck/base_link"
    assert received["truck/imu/base/data"][0].header.frame_id == "truck/base_link"
    assert received["digger/bucket/wrench"][0].header.frame_id == "digger/bucket"
    assert received["truck/bed/wrench"][0].header.frame_id == "truck/bed"
    frames = {message.child_frame_id for message in received["truck/transforms"]}
    assert frames >= {"truck/base_link", "truck/bed"}
    assert all(frame.startswith("truck/") for frame in frames)
    assert '"truck/bed"' in received["truck/robot_description"][0].data
    config = yaml.safe_load(received["config"][0].data)
    assert config["machines"]["truck"]["machine"] == DUMPER
    topics = {publisher.topic_name for publisher in node.publishers}
    shared = {"/site/particles", "/site/state_hash", "/site/config", "/site/soil_tick"}
    shared |= {"/site/contacts"}
    assert shared == {t for t in topics if t.startswith("/site/") and t.count("/") == 2}
    assert balanced(scene)


def test_bin_publishes_its_payload_and_markers(ros: Ros) -> None:
    scene = Scene(ros)
    payloads = ros.collect("/site/hopper/payload", Float64MultiArray, qos.STATE)
    markers = ros.collect("/site/hopper/markers", MarkerArray, qos.STATE)
    config = ros.collect("/site/config", String, qos.TRANSIENT_LOCAL)
    node = digger_and_truck(scene, bins=["hopper"], **{"hopper.x": 6.0, "hopper.height": 2.0})
    scene.until_tick(3)
    assert node.run is not None
    soil = np.array([[6.0, 0.1 * k, 0.5] for k in range(-5, 5)])
    node.run.sim.particles.add(soil, np.zeros_like(soil), 1_000_000)
    ros.spin_until(
        lambda: payloads and from_payload_array(payloads[-1]).bank_m3 == pytest.approx(0.01)
    )
    assert yaml.safe_load(config[0].data)["bins"]["hopper"]["height"] == 2.0
    ros.spin_until(lambda: markers)
    walls = markers[-1].markers
    assert max(wall.pose.position.z + 0.5 * wall.scale.z for wall in walls) > 1.9
    assert np.mean([wall.pose.position.x for wall in walls]) == pytest.approx(6.0, abs=0.1)


def test_command_moves_only_its_machine(ros: Ros) -> None:
    scene = Scene(ros)
    node = digger_and_truck(scene)
    scene.until_tick(30)  # settled on the ground
    assert node.run is not None
    digger, truck = (rig.machine for rig in node.run.sim.simulated_machines)
    before = digger.joint_positions, digger.base_pose[0]
    bed = ros.publisher("/site/truck/joint_commands", JointState, subscriptions=1)
    bed.publish(JointState(name=["bed", "left_track", "right_track"], velocity=[-0.2, 0.5, 0.5]))
    ros.spin_until(lambda: truck.joint_positions[0] < -0.1 and truck.base_pose[0][0] > 0.1)
    np.testing.assert_allclose(digger.joint_positions, before[0], atol=1e-3)
    np.testing.assert_allclose(digger.base_pose[0], before[1], atol=5e-3)
    ros.publisher("/site/truck/emergency_stop", Bool, subscriptions=1).publish(Bool(data=True))
    scene.until_shown(node, "truck/emergency_stop", True)
    scene.until_shown(node, "digger/emergency_stop", False)
    ros.spin_until(lambda: abs(truck.joint_velocities[0]) < 1e-3)
    stood = truck.joint_positions[0]
    swing = ros.publisher(
        "/site/digger/front_velocity_controller/commands", Float64MultiArray, subscriptions=1
    )
    swing.publish(Float64MultiArray(data=[0.4, 0.0, 0.0, 0.0]))
    ros.spin_until(lambda: digger.joint_positions[0] > 0.1)
    assert truck.joint_positions[0] == pytest.approx(stood, abs=3e-3)
    bed.publish(JointState(name=["swing"], velocity=[0.1]))
    scene.until_shown(node, "rejected truck/joint_commands", 1)
    assert balanced(scene)


def test_node_of_two_machines_digs_leaves_and_rejoins(ros: Ros, tmp_path: Path) -> None:
    scene = Scene(ros, sync="realtime", machine_timeout=0.4)
    path = machine_file(tmp_path, ready_to_dig())
    node = digger_and_truck(scene, **{"digger.machine": path})
    dig(scene, node, lambda ledger: ledger.particles > 10**7, "digger")
    scene.until_shown(node, "truck/payload_fill", "0.000")
    ros.executor.remove_node(node)  # as if its process were stopped
    ros.spin_until(lambda: scene.joined == ())
    scene.more_ticks(2)
    assert scene.ledgers[-1].absent > 10**7
    ros.executor.add_node(node)
    ros.spin_until(lambda: scene.joined == (1,))
    scene.more_ticks(10)
    assert scene.ledgers[-1].absent == 0
    states = [ros.collect(f"/site/{name}/joint_states", JointState) for name in ("digger", "truck")]
    ros.spin_until(lambda: all(states))
    scene.leave(node)
    assert scene.joined == ()
    assert balanced(scene)


def test_excavator_and_road_header_join_in_separate_nodes(ros: Ros) -> None:
    heads = ros.collect("/road_header/head/wrench", WrenchStamped, qos.STATE)
    states = ros.collect("/road_header/joint_states", JointState, qos.STATE)
    buckets = ros.collect("/excavator/bucket/wrench", WrenchStamped, qos.STATE)
    scene = Scene(ros, expected_machines=[1, 2])
    scene.machine(y=5.0)
    options = {"machine": ROAD_HEADER, "commands.command_timeout": 60.0}
    second = scene.machine("/road_header", machine_id=2, y=-5.0, **options)
    scene.until_tick(5)
    assert scene.joined == (1, 2)
    front = ros.publisher(
        "/road_header/front_velocity_controller/commands", Float64MultiArray, subscriptions=1
    )
    front.publish(Float64MultiArray(data=[0.2, 0.0, 3.0]))
    ros.spin_until(lambda: states and own_joints(states[-1])["turn"] > 0.05)
    assert list(own_joints(states[-1])) == ["turn", "lift", "head", *BASE_JOINTS]
    ros.spin_until(lambda: heads and buckets)
    assert heads[0].header.frame_id == "road_header/head"
    assert "/road_header/payload" not in {each.topic_name for each in second.publishers}
    assert balanced(scene)


@pytest.mark.parametrize(
    ("parameters", "name"),
    [
        ({"machines": ["digger", "digger"]}, "digger"),
        ({"machines": ["2nd"]}, "2nd"),
        ({"machines": ["a__b"]}, "a__b"),
        ({"machines": ["particles"]}, "particles"),
        ({"machines": ["a", "b"], "x": 2.0}, r"a\.x"),
        ({"machines": ["a", "b"]}, r"b\.x"),
        ({"machines": ["a", "b"], "b.x": "far"}, r"b\.x"),
        ({"machines": ["a", "b"], "b.x": 5.0, "c.x": 9.0}, r"no parameter c\.x \(did you mean"),
        ({"digger.x": 1.0}, r"no parameter digger\.x"),
        ({"bins": ["commands"]}, "commands"),
        ({"machines": ["a"], "bins": ["a"]}, "'a'"),
        ({"machines": ["seed"]}, "seed"),
        (
            {"machines": ["a", "b"], "b.x": 9.0, "a.frame_prefix": "b/"},
            r"a\.frame_prefix",
        ),
        ({"bins": ["hopper"], "hopper.width": 0.0}, r"hopper\.width is 0"),
    ],
)
def test_invalid_parameters_are_rejected(ros: Ros, parameters: dict[str, Any], name: str) -> None:
    with pytest.raises(ParameterError, match=name):
        ros.add(MachineNode, parameters=parameters)


def test_shipped_site_file_has_its_machines(ros: Ros) -> None:
    content = yaml.safe_load(find_config("site_machines.yaml").read_text())
    given = content["/**/machine_sim"]["ros__parameters"]
    flat = {"machines": given.pop("machines")}
    for name, group in given.items():
        flat |= {f"{name}.{key}": value for key, value in group.items()}
    node: MachineNode = ros.add(MachineNode, namespace="/site", parameters=flat)
    assert [each.name for each in node.instances] == ["digger", "truck"]
    assert [each.spec.name for each in node.instances] == ["excavator", "dumper"]
