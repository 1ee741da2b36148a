"""The robot description: meshes inside the URDF, wheels that follow the belts, view points."""

import base64
import io
import math
import xml.etree.ElementTree as ET

import numpy as np
import pytest
import trimesh

from machine_sim.machine import load_machine_spec
from machine_sim.machine.description import description_text
from machine_sim.machine.rotations import rotation_from_rpy
from machine_sim.machine.shapes.link_meshes import link_meshes, num_triangles, shoe_mesh
from machine_sim.machine.shapes.machine_shapes import ViewPoint
from machine_sim.machine.track_wheels import BeltOdometer
from msg_bridge.config_files import find_config

MAX_DESCRIPTION_BYTES = 600_000
MAX_TRIANGLES = 12_000
PREFIX = "data:model/gltf-binary;base64,"


@pytest.fixture(scope="module")
def robot(spec):
    return ET.fromstring(description_text(spec, prefix="digger/"))


def decoded(uri):
    """Return the triangles of a GLB by material, link frame, and the whole scene."""
    assert uri.startswith(PREFIX)
    data = base64.b64decode(uri.removeprefix(PREFIX))
    scene = trimesh.load_scene(io.BytesIO(data), file_type="glb")
    # Programs with z up, such as Lichtblick, rotate a glTF by +90 degrees about x.
    scene.apply_transform(trimesh.transformations.rotation_matrix(0.5 * math.pi, [1.0, 0.0, 0.0]))
    meshes = {mesh.visual.material.name: mesh for mesh in scene.dump()}
    return {name: mesh.triangles for name, mesh in meshes.items()}, meshes


@pytest.mark.parametrize("name", ["excavator", "dumper", "road_header"])
def test_description_is_of_a_size_that_a_topic_can_carry_and_a_page_can_draw(name):
    spec = load_machine_spec(find_config(f"machines/{name}.yaml"))
    assert len(description_text(spec)) < MAX_DESCRIPTION_BYTES
    assert num_triangles(link_meshes(spec).values()) <= MAX_TRIANGLES


def test_every_shown_link_has_one_mesh_with_the_triangles_of_its_shapes(spec, robot):
    expected = link_meshes(spec)
    links = {link.get("name"): link for link in robot.iter("link")}
    for frame, groups in expected.items():
        (mesh,) = links[f"digger/{frame}"].iterfind("visual/geometry/mesh")
        triangles, _ = decoded(mesh.get("filename"))
        assert set(triangles) == {group.name for group in groups}
        for group in groups:
            corners = group.mesh.points[group.mesh.triangles]
            np.testing.assert_allclose(triangles[group.name], corners, atol=1e-5)


def test_shoe_of_the_belts_has_a_mesh(spec, robot):
    triangles, _ = decoded(robot.find("earthmoving/shoe/mesh").get("filename"))
    assert sum(map(len, triangles.values())) == sum(
        len(group.mesh.triangles) for group in shoe_mesh(spec)
    )


def test_primitives_have_no_mesh(spec):
    text = description_text(spec, meshes="primitives")
    assert "data:" not in text
    shapes = {shape.tag for geometry in ET.fromstring(text).iter("geometry") for shape in geometry}
    assert shapes == {"box", "cylinder"}


def test_belts_are_described_by_their_dimensions(spec, robot):
    tracks = {track.get("joint"): track for track in robot.iterfind("earthmoving/track")}
    assert list(tracks) == ["left_sprocket", "right_sprocket"]
    left = tracks["left_sprocket"]
    assert left.get("link") == "digger/base_link"
    assert float(left.get("y")) == 0.5 * spec.tracks.gauge
    assert float(left.get("radius")) == spec.tracks.sprocket_radius
    assert int(left.get("shoe_count")) == spec.tracks.shoe_count


def test_view_points_are_fixed_to_links(robot):
    fixed = {
        joint.find("child").get("link"): joint.find("parent").get("link")
        for joint in robot.iter("joint")
        if joint.get("type") == "fixed"
    }
    assert fixed["digger/cab_camera"] == "digger/upper"
    names = (
        "cab_camera",
        "cab_camera_optical",
        "bucket_camera",
        "bucket_camera_optical",
        "exhaust",
    )
    assert set(fixed) == {f"digger/{name}" for name in names}


def test_optical_frame_of_a_camera_looks_along_z_with_y_down():
    camera = ViewPoint("cab_camera", "upper", (1.0, 2.0, 3.0), (0.1, 0.4, -0.7))
    optical = camera.optical_frame()
    assert (optical.name, optical.position) == ("cab_camera_optical", camera.position)
    body, image = rotation_from_rpy(camera.rpy), rotation_from_rpy(optical.rpy)
    np.testing.assert_allclose(image[:, 2], body[:, 0], atol=1e-12)
    np.testing.assert_allclose(image[:, 1], -body[:, 2], atol=1e-12)
    np.testing.assert_allclose(image[:, 0], -body[:, 1], atol=1e-12)


def test_sprocket_angle_is_the_total_travel_over_the_radius(spec):
    odometer, length = BeltOdometer(spec), spec.tracks.belt_length
    for travel in np.arange(0.0, 3.0 * length, 0.3):
        odometer.update([travel % length, -0.5 * travel % length])
        radius = spec.tracks.sprocket_radius
        assert odometer.angles == pytest.approx((travel / radius, -0.5 * travel / radius))
