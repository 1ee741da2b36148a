"""The markers show the machine at the pose of its kinematics, without TF."""

import math

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from support.machine_scenes import excavator
from support.wire import over_the_wire, raises
from visualization_msgs.msg import Marker

from machine_sim.machine import rotation_matrix, tool_pose
from machine_sim.machine.forward_kinematics import link_frame_names, link_poses
from machine_sim.machine.visuals import marker_boxes, shoe_visual
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.markers import LinkBox, MarkerSet
from msg_bridge.contract.errors import ErrorCode

MACHINE = excavator()
STAMP = Time(sec=3, nanosec=40_000_000)
POSITION = np.array([3.0, -2.0, 0.5])
TURN = np.array([0.05, -0.1, 0.4, 0.9]) / np.linalg.norm([0.05, -0.1, 0.4, 0.9])
JOINTS = [0.7, -0.4, 1.3, 1.1]
SHOES = np.random.default_rng(4).uniform(-1.5, 1.5, (2, MACHINE.tracks.shoe_count, 3))
CORNERS = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)])
FIXED_LINK_BOX = LinkBox("base", (1.0, 1.0, 1.0), (0.0, 0.0, 0.0), 0.0, (1.0, 1.0, 1.0, 1.0))
AT_ORIGIN = ([[0.0, 0.0, 0.0]], [[0.0, 0.0, 0.0, 1.0]])


def marker_set():
    return MarkerSet(
        link_frame_names(MACHINE),
        marker_boxes(MACHINE),
        shoe_visual(MACHINE),
        namespace="digger",
    )


def markers_at(position=POSITION, turn=TURN, joints=JOINTS, shoes=SHOES):
    msg = marker_set().at(link_poses(MACHINE, position, turn, joints), shoes, STAMP)
    return over_the_wire(msg).markers


def placed(marker, points):
    """Return points of a marker frame in the map frame."""
    at, turn = marker.pose.position, marker.pose.orientation
    rotation = rotation_matrix([turn.x, turn.y, turn.z, turn.w])
    return np.asarray(points) @ rotation.T + [at.x, at.y, at.z]


def corners(marker):
    size = np.array([marker.scale.x, marker.scale.y, marker.scale.z])
    return placed(marker, 0.5 * CORNERS * size)


def of_link(markers, name):
    return [marker for marker in markers if marker.ns == f"digger/{name}"]


def as_set(points):
    return {tuple(point) for point in np.round(np.reshape(points, (-1, 3)), 6).tolist()}


def test_boxes_are_placed_with_their_links():
    poses = link_poses(MACHINE, POSITION, TURN, JOINTS)
    frames = dict(zip(link_frame_names(MACHINE), zip(*poses, strict=True), strict=True))
    boxes = marker_boxes(MACHINE)
    markers = [marker for marker in markers_at() if not marker.ns.endswith("/tracks")]
    for marker, box in zip(markers, boxes, strict=True):
        origin, quaternion = frames[box.link]
        s, c = math.sin(box.pitch), math.cos(box.pitch)
        about_y = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        local = 0.5 * CORNERS * np.array(box.size) @ about_y.T + box.center
        expected = local @ rotation_matrix(quaternion).T + origin
        np.testing.assert_allclose(corners(marker), expected, atol=2e-9)


def test_bucket_is_drawn_around_its_plates():
    """The mid-plane corners of each floor strip's box are the four corners of the strip."""
    rotation, pin = tool_pose(MACHINE, POSITION, rotation_matrix(TURN), JOINTS)
    strips = [plate @ rotation.T + pin for plate in MACHINE.bucket.plates()[:6]]
    for box, strip in zip(of_link(markers_at(), "bucket")[:6], strips, strict=True):
        size = np.array([box.scale.x, box.scale.y, 0.0])
        middle_corners = placed(box, 0.5 * CORNERS[:4] * size)
        np.testing.assert_allclose(sorted(as_set(middle_corners)), sorted(as_set(strip)), atol=2e-6)


def test_every_box_of_the_urdf_has_its_colour():
    markers = markers_at()
    boxes = marker_boxes(MACHINE)
    cubes = [marker for marker in markers if marker.type == Marker.CUBE]
    assert len(cubes) == len(boxes)
    for marker, box in zip(cubes, boxes, strict=True):
        assert (marker.scale.x, marker.scale.y, marker.scale.z) == box.size
        shown = (marker.color.r, marker.color.g, marker.color.b, marker.color.a)
        assert shown == pytest.approx(box.color)


def test_bars_lie_in_their_shoes():
    """Each bar's middle is on the line of its shoe; the middles' mean is the shoe's middle."""
    tracks = MACHINE.tracks
    length = shoe_visual(MACHINE).shoe_size[0]
    for side, marker in enumerate(of_link(markers_at(), "tracks")):
        assert marker.type == Marker.CUBE_LIST
        bars = len(marker.points) // tracks.shoe_count
        assert marker.scale.x * bars == pytest.approx(length)
        assert marker.scale.x == pytest.approx(marker.scale.z, rel=0.1)
        assert marker.scale.y == tracks.shoe_width
        points = placed(marker, [[p.x, p.y, p.z] for p in marker.points])
        points = (points - POSITION) @ rotation_matrix(TURN)  # base frame
        for (x, z, pitch), row in zip(
            SHOES[side], points.reshape(tracks.shoe_count, bars, 3), strict=True
        ):
            y = (0.5 - side) * tracks.gauge
            np.testing.assert_allclose(row.mean(axis=0), [x, y, z], atol=1e-9)
            along = np.array([math.cos(pitch), 0.0, -math.sin(pitch)])
            np.testing.assert_allclose(
                row[-1] - row[0], along * length * (bars - 1) / bars, atol=1e-9
            )


def test_one_marker_for_a_track():
    assert [marker.id for marker in of_link(markers_at(), "tracks")] == [0, 1]


def test_markers_need_no_tf():
    for marker in markers_at():
        assert marker.header.frame_id == "map"
        assert marker.header.stamp == STAMP
        assert marker.action == Marker.ADD
        turn = marker.pose.orientation
        assert math.hypot(turn.x, turn.y, turn.z, turn.w) == pytest.approx(1.0, abs=1e-12)


def test_names_are_unique_and_constant():
    here = [(marker.ns, marker.id) for marker in markers_at()]
    there = [(marker.ns, marker.id) for marker in markers_at(POSITION + 1.0, joints=[0.0] * 4)]
    assert here == there
    assert len(set(here)) == len(here)
    assert {name for name, _ in here} == {
        f"digger/{link}" for link in (*(box.link for box in marker_boxes(MACHINE)), "tracks")
    }


def test_second_pose_is_independent_of_the_first():
    markers = marker_set()
    markers.at(link_poses(MACHINE, POSITION, TURN, JOINTS), SHOES, STAMP)
    pose = link_poses(MACHINE, POSITION + 5.0, [0.0, 0.0, 0.0, 1.0], [0.1, 0.2, 0.9, 0.4])
    late = Time(sec=9)
    again = markers.at(pose, 0.5 * SHOES, late)
    assert again == marker_set().at(pose, 0.5 * SHOES, late)


def test_machine_without_tracks_has_boxes_only():
    markers = (
        MarkerSet(["base"], [FIXED_LINK_BOX], namespace="drill").at(AT_ORIGIN, None, STAMP).markers
    )
    assert [(marker.ns, marker.id) for marker in markers] == [("drill/base", 0)]


def test_box_of_an_unknown_link_is_rejected():
    with raises(ErrorCode.LABELS, CodecError):
        MarkerSet(["bed"], [FIXED_LINK_BOX], namespace="truck")


def test_poses_of_other_shapes_are_rejected():
    pose = link_poses(MACHINE, POSITION, TURN, JOINTS)
    with raises(ErrorCode.SHAPE, CodecError):
        marker_set().at((pose.positions[:4], pose.quaternions), SHOES, STAMP)
    with raises(ErrorCode.SHAPE, CodecError):
        marker_set().at(pose, SHOES[:, :3], STAMP)
    with raises(ErrorCode.SHAPE, CodecError):
        marker_set().at(pose, None, STAMP)
