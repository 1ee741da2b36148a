"""Joint states place all links; commands and payload are transmitted exactly."""

import math
import xml.etree.ElementTree as ET

import numpy as np
import pybullet
import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from support.machine_scenes import COMMAND_NAMES, excavator
from support.wire import over_the_wire, raises

from machine_sim.machine import EXCAVATOR_JOINTS, rotation_matrix, urdf_text
from machine_sim.machine.cylinder_visuals import cylinder_joint_states
from machine_sim.machine.description import description_text
from machine_sim.machine.forward_kinematics import link_frame_names, link_poses
from machine_sim.machine.urdf import BASE_JOINTS as URDF_JOINTS
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.machine_state import (
    BASE_JOINTS,
    BaseState,
    JointValues,
    PayloadState,
    TrackValues,
    from_command_state,
    from_cylinder_array,
    from_payload_array,
    from_track_array,
    to_command_state,
    to_cylinder_array,
    to_joint_state,
    to_payload_array,
    to_track_array,
)
from msg_bridge.contract.cylinder_state import CylinderState
from msg_bridge.contract.errors import ErrorCode

MACHINE = excavator()
STAMP = Time(sec=3, nanosec=40_000_000)
AT_REST = np.zeros(3)
HOME = np.zeros(4)
SPROCKETS = (7.0, -2.5)
UPRIGHT = [0.0, 0.0, 0.0, 1.0]


def quaternion(yaw, pitch, roll):
    """Return the quaternion (x, y, z, w) of intrinsic rotations by yaw, pitch and roll [rad]."""
    (sy, sp, sr), (cy, cp, cr) = (f(0.5 * np.array([yaw, pitch, roll])) for f in (np.sin, np.cos))
    return np.array(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )


def product(a, b):
    """Return the quaternion of b followed by a, both about fixed axes."""
    cross = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.array([*cross, a[3] * b[3] - a[:3] @ b[:3]])


def rotation_about(axis, angle):
    """Return a rotation matrix by Rodrigues' formula."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + math.sin(angle) * skew + (1.0 - math.cos(angle)) * skew @ skew


def fixed_rotation(rpy):
    """Return the rotation matrix of roll, pitch and yaw about fixed axes."""
    roll, pitch, yaw = map(float, rpy.split())
    return (
        rotation_about([0.0, 0.0, 1.0], yaw)
        @ rotation_about([0.0, 1.0, 0.0], pitch)
        @ rotation_about([1.0, 0.0, 0.0], roll)
    )


def forward_kinematics(urdf, state):
    """Return rotation and origin of each link of a URDF as robot_state_publisher, root at 0."""
    values = dict(zip(state.name, state.position, strict=True))
    robot = ET.fromstring(urdf)
    joints = {joint.find("child").get("link"): joint for joint in robot.iter("joint") if len(joint)}
    frames = {}

    def frame(link):
        if link not in joints:
            return np.eye(3), np.zeros(3)
        if link not in frames:
            joint = joints[link]
            turn, origin = frame(joint.find("parent").get("link"))
            if (shift := joint.find("origin")) is not None:
                origin = origin + turn @ np.array(shift.get("xyz").split(), dtype=float)
                turn = turn @ fixed_rotation(shift.get("rpy", "0 0 0"))
            if joint.get("type") == "fixed":
                frames[link] = turn, origin
                return frames[link]
            axis = np.array(joint.find("axis").get("xyz").split(), dtype=float)
            mimic = joint.find("mimic")
            value = values[joint.get("name") if mimic is None else mimic.get("joint")]
            if joint.get("type") == "prismatic":
                origin = origin + turn @ axis * value
            else:
                turn = turn @ rotation_about(axis, value)
            frames[link] = turn, origin
        return frames[link]

    return {link.get("name"): frame(link.get("name")) for link in robot.iter("link")}


def random_poses(count):
    """(position, quaternion, joints), every third one with a pitch of 90 degrees or nearly."""
    rng = np.random.default_rng(5)
    for k in range(count):
        yaw, roll = rng.uniform(-math.pi, math.pi, 2)
        pitch = rng.uniform(-1.5, 1.5)
        if k % 3 == 0:
            off = rng.choice([0.0, 1e-16, 1e-12, 1e-8, 1e-5, 1e-3])
            pitch = rng.choice([-1.0, 1.0]) * (0.5 * math.pi - off)
        joints = [
            rng.uniform(max(limit.lower, -9.0), min(limit.upper, 9.0))
            for limit in MACHINE.joints.values()
        ]
        yield rng.uniform(-50.0, 50.0, 3), quaternion(yaw, pitch, roll), np.array(joints)


def joint_state(position, turn, joints, velocity=AT_REST, angular_velocity=AT_REST):
    base = BaseState(position, turn, velocity, angular_velocity)
    pistons = cylinder_joint_states(MACHINE, list(joints), [0.0] * 4)
    names = [*EXCAVATOR_JOINTS, *pistons.names, "left_sprocket", "right_sprocket"]
    positions = [*joints, *pistons.positions, *SPROCKETS]
    still = np.zeros(len(names))
    return over_the_wire(to_joint_state(JointValues(names, positions, still, still), base, STAMP))


def test_names_are_those_of_the_machine_and_its_urdf():
    assert list(EXCAVATOR_JOINTS) == list(joint_state(AT_REST, UPRIGHT, HOME).name)[:4]
    assert BASE_JOINTS == URDF_JOINTS
    state = joint_state(AT_REST, UPRIGHT, np.zeros(4))
    robot = ET.fromstring(description_text(MACHINE, meshes="primitives"))
    own = [joint for joint in robot.iter("joint") if joint.get("type") != "fixed"]
    assert sorted(state.name) == sorted(
        joint.get("name") for joint in own if joint.find("mimic") is None
    )
    assert state.header.stamp == STAMP


def test_joint_values_place_every_link_of_the_urdf():
    urdf = description_text(MACHINE, prefix="digger/", meshes="primitives")
    for position, turn, joints in random_poses(150):
        frames = forward_kinematics(urdf, joint_state(position, turn, joints))
        where = link_poses(MACHINE, position, turn, joints, SPROCKETS)
        for k, link in enumerate(link_frame_names(MACHINE)):
            rotation, origin = frames[f"digger/{link}"]
            np.testing.assert_allclose(origin, where.positions[k], atol=1e-9)
            np.testing.assert_allclose(rotation, rotation_matrix(where.quaternions[k]), atol=1e-9)


def test_joint_values_place_the_links_where_the_physics_has_them(tmp_path):
    """The physics engine's own link poses are no better than 2e-6; the base's are exact."""
    (tmp_path / "machine.urdf").write_text(urdf_text(MACHINE))
    urdf = urdf_text(MACHINE, virtual_base=True)
    middle = np.array(MACHINE.links["base"].center_of_mass)
    client = pybullet.connect(pybullet.DIRECT)
    try:
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE | pybullet.URDF_MAINTAIN_LINK_ORDER
        body = pybullet.loadURDF(
            str(tmp_path / "machine.urdf"), flags=flags, physicsClientId=client
        )
        for position, turn, joints in random_poses(30):
            frames = forward_kinematics(urdf, joint_state(position, turn, joints))
            com = position + rotation_matrix(turn) @ middle
            pybullet.resetBasePositionAndOrientation(
                body, com.tolist(), turn.tolist(), physicsClientId=client
            )
            for k, angle in enumerate(joints.tolist()):
                pybullet.resetJointState(body, k, angle, 0.0, client)
            com, turned = pybullet.getBasePositionAndOrientation(body, client)
            rotation, origin = frames["base_link"]
            np.testing.assert_allclose(rotation_matrix(turned), rotation, atol=1e-9)
            np.testing.assert_allclose(com - rotation_matrix(turned) @ middle, origin, atol=1e-9)
            for k, link in enumerate(link_frame_names(MACHINE)[1:5]):
                state = pybullet.getLinkState(body, k, 0, 1, client)
                np.testing.assert_allclose(state[4], frames[link][1], atol=1e-5)
                np.testing.assert_allclose(rotation_matrix(state[5]), frames[link][0], atol=1e-5)
    finally:
        pybullet.disconnect(client)


def test_velocities_are_the_time_derivatives_of_the_positions():
    rng = np.random.default_rng(8)
    dt = 1e-6
    for _ in range(50):
        turn = quaternion(*rng.uniform([-3.0, -1.3, -3.0], [3.0, 1.3, 3.0]))
        place, velocity, angular_velocity = rng.uniform(-1.0, 1.0, (3, 3))
        before, after = (
            np.array(
                joint_state(
                    place + velocity * t,
                    product(np.append(0.5 * angular_velocity * t, 1.0), turn),
                    HOME,
                ).position
            )
            for t in (-dt, dt)
        )
        found = joint_state(place, turn, HOME, velocity, angular_velocity).velocity
        np.testing.assert_allclose(found, (after - before) / (2.0 * dt), atol=1e-7)


def test_velocities_are_finite_at_a_pitch_of_90_degrees():
    state = joint_state(
        AT_REST, quaternion(0.4, -0.5 * math.pi, 0.1), HOME, AT_REST, [1.0, 2.0, 3.0]
    )
    assert np.abs(state.velocity).max() < 10.0


def test_values_of_the_joints_come_first():
    values = [np.arange(4.0) + 10.0 * k for k in range(3)]
    base = BaseState(AT_REST, UPRIGHT, AT_REST, AT_REST)
    state = over_the_wire(to_joint_state(JointValues(EXCAVATOR_JOINTS, *values), base, STAMP))
    assert state.name[:4] == list(EXCAVATOR_JOINTS)
    for found, own in zip((state.position, state.velocity, state.effort), values, strict=True):
        assert len(found) == 10
        assert list(found[:4]) == own.tolist()
        assert list(found[4:]) == [0.0] * 6


def test_wrong_number_of_joints_is_rejected():
    base = BaseState(AT_REST, UPRIGHT, AT_REST, AT_REST)
    with raises(ErrorCode.SHAPE, CodecError):
        to_joint_state(JointValues(EXCAVATOR_JOINTS, HOME, AT_REST, HOME), base, STAMP)


@pytest.mark.parametrize("turn", [[0.0] * 4, [math.nan, 0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
def test_invalid_base_rotation_is_rejected(turn):
    with raises(ErrorCode.VALUE, CodecError):
        joint_state(AT_REST, turn, HOME)


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=6, max_size=6))
def test_command_is_transmitted_bit_by_bit(velocities):
    msg = over_the_wire(to_command_state(COMMAND_NAMES, velocities, STAMP))
    assert msg.header.stamp == STAMP
    assert from_command_state(msg, COMMAND_NAMES).tobytes() == np.array(velocities).tobytes()


def test_command_of_another_machine_is_transmitted():
    names = ("drum", "left_track")
    msg = over_the_wire(to_command_state(names, [1.5, -0.5], STAMP))
    assert from_command_state(msg, names).tolist() == [1.5, -0.5]


@pytest.mark.parametrize(
    ("change", "code"),
    [
        ({"name": list(COMMAND_NAMES[::-1])}, ErrorCode.LABELS),
        ({"name": list(COMMAND_NAMES[:4])}, ErrorCode.LABELS),
        ({"name": []}, ErrorCode.LABELS),
        ({"velocity": [0.0] * 5}, ErrorCode.LAYOUT),
        ({"velocity": []}, ErrorCode.LAYOUT),
        ({"velocity": [0.0] * 5 + [math.nan]}, ErrorCode.VALUE),
        ({"velocity": [math.inf] + [0.0] * 5}, ErrorCode.VALUE),
        ({"position": [0.0] * 6}, ErrorCode.LAYOUT),
        ({"effort": [0.0] * 6}, ErrorCode.LAYOUT),
    ],
)
def test_invalid_command_is_rejected(change, code):
    parts = {"name": list(COMMAND_NAMES), "velocity": [0.0] * 6}
    with raises(code, CodecError):
        from_command_state(over_the_wire(JointState(**{**parts, **change})), COMMAND_NAMES)


def test_command_that_cannot_be_applied_is_not_sent():
    with raises(ErrorCode.VALUE, CodecError):
        to_command_state(COMMAND_NAMES, [0.0, math.nan, 0.0, 0.0, 0.0, 0.0], STAMP)
    with raises(ErrorCode.SHAPE, CodecError):
        to_command_state(COMMAND_NAMES, [0.0], STAMP)


def test_payload_is_labelled_with_names_and_units():
    payload = PayloadState(0.8, 1.0, 1440.0, 0.9, 12.5)
    msg = over_the_wire(to_payload_array(payload))
    assert msg.layout.dim[0].label == "bank_m3,loose_m3,mass_kg,fill,time_s"
    assert list(msg.data) == [0.8, 1.0, 1440.0, 0.9, 12.5]
    assert from_payload_array(msg) == payload


@pytest.mark.parametrize(
    "label", ["loose_m3,bank_m3,mass_kg,fill,time_s", "bank_m3,loose_m3,mass_kg,fill,new"]
)
def test_array_with_other_labels_is_no_payload(label):
    msg: Float64MultiArray = to_payload_array(PayloadState(0.0, 0.0, 0.0, 0.0))
    msg.layout.dim[0].label = label
    with raises(ErrorCode.LABELS, CodecError):
        from_payload_array(msg)


def test_tracks_are_labelled_and_have_their_time():
    left, right = TrackValues(0.12, 0.03, 0.8, 4e4), TrackValues(-0.2, 0.0, -0.8, -1e4)
    msg = over_the_wire(to_track_array(left, right, 7.25))
    assert msg.layout.dim[0].label.startswith("left_slip,left_sinkage_m,left_speed_m_s,")
    assert from_track_array(msg) == (left, right, 7.25)
    msg.layout.dim[0].label = msg.layout.dim[0].label.replace("left", "front")
    with raises(ErrorCode.LABELS, CodecError):
        from_track_array(msg)


def test_cylinders_are_labelled_and_have_their_time():
    cylinders = {
        "boom": CylinderState(2.1, 0.1, 3e5, 1.4e7, 5e5),
        "arm": CylinderState(3.0, -0.2, -1e5, 5e5, 1.5e7),
    }
    msg = over_the_wire(to_cylinder_array(cylinders, 7.25))
    assert msg.layout.dim[0].label.startswith("boom_length_m,boom_speed_m_s,boom_force_n,")
    assert from_cylinder_array(msg, ["boom", "arm"]) == (cylinders, 7.25)
    with raises(ErrorCode.LABELS, CodecError):
        from_cylinder_array(msg, ["arm", "boom"])
