"""Meshes of visual shapes: closed, facing outward, and as large as their dimensions."""

import math

import numpy as np
import pytest
from support.machine_scenes import load_shipped_machine

from machine_sim.machine import MachineError
from machine_sim.machine.cylinder_visuals import cylinder_parts
from machine_sim.machine.shapes.cylinder_solids import cylinder_solids
from machine_sim.machine.shapes.link_meshes import link_meshes, link_solids
from machine_sim.machine.shapes.solids import box, cylinder, extrusion, revolution, tube
from machine_sim.machine.shapes.track_solids import idler_solids, shoe_solids, sprocket_solids
from machine_sim.machine.shapes.triangle_mesh import shade

MACHINES = ["excavator", "dumper", "road_header", "reference_2014"]
L_SHAPE = [[0.0, 0.0], [2.0, 0.0, 0.2], [2.0, 1.0], [1.0, 1.0, 0.3], [1.0, 2.0], [0.0, 2.0]]


def edges(mesh):
    """Return the directed edges of all triangles, without triangles that have lost their area."""
    a, b, c = mesh.triangles.T
    pairs = np.concatenate([np.column_stack(pair) for pair in ((a, b), (b, c), (c, a))])
    return [tuple(pair) for pair in pairs.tolist()]


def assert_closed_and_outward(mesh):
    found = edges(mesh)
    assert len(set(found)) == len(found), "an edge belongs to two triangles of one orientation"
    assert {(b, a) for a, b in found} == set(found), "an edge belongs to one triangle only"
    assert mesh.volume > 0.0, "the triangles face inward"


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("bevel", [0.0, 0.05])
def test_extrusion_is_closed_on_every_axis(axis, bevel):
    hole = [[0.2, 0.2, 0.1], [0.8, 0.2, 0.1], [0.8, 0.8, 0.1], [0.2, 0.8, 0.1]]
    mesh = extrusion(L_SHAPE, 0.4, axis=axis, position=1.0, bevel=bevel, holes=[hole])
    assert_closed_and_outward(mesh)
    along = "xyz".index(axis)
    assert (mesh.points[:, along].min(), mesh.points[:, along].max()) == pytest.approx((0.8, 1.2))
    assert mesh.volume == pytest.approx((3.0 - 0.36) * 0.4, rel=0.08)


@pytest.mark.parametrize(
    ("mesh", "volume"),
    [
        (box([1.0, 2.0, 3.0]), 6.0),
        (box([1.0, 2.0, 3.0], 0.1), 5.9),
        (cylinder(0.5, 2.0, sides=48), 0.5 * math.pi),
        (cylinder(0.5, 2.0, bore=0.3, axis="x", sides=48), 0.32 * math.pi),
        (cylinder(0.5, 3.0, end_radius=0.25, axis="z", bevel=0.01, sides=48), 0.4375 * math.pi),
        (revolution([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)], sides=48), math.pi / 3.0),
        (tube([[0, 0, 0], [0, 0, 2.0]], 0.1, sides=48), 0.02 * math.pi),
        (tube([[0, 0, 0], [1.0, 0, 0], [1.0, 1.0, 0]], 0.1, bend=0.5, sides=48), 0.0561),
    ],
    ids=lambda value: "" if isinstance(value, float) else f"{len(value.triangles)} triangles",
)
def test_volume_of_a_body_is_that_of_its_dimensions(mesh, volume):
    assert_closed_and_outward(mesh)
    assert mesh.volume == pytest.approx(volume, rel=0.03)


def test_mirrored_body_faces_outward():
    mesh = extrusion(L_SHAPE, 0.4, position=1.0)
    assert_closed_and_outward(mesh.mirrored())
    assert mesh.mirrored().points[:, 1].max() == pytest.approx(-0.8)


def test_bevel_wider_than_an_edge_is_an_error():
    with pytest.raises(MachineError, match=r"bevel 0\.3 m .* give a smaller bevel"):
        extrusion([[0.0, 0.0], [1.0, 0.0], [1.0, 0.1], [0.0, 1.0]], 1.0, bevel=0.3)


def test_edges_of_a_bevelled_body_are_smooth_and_of_a_sharp_one_hard():
    sharp, round_box = shade(box([1.0, 1.0, 1.0])), shade(box([1.0, 1.0, 1.0], 0.05))
    assert len(sharp.points) == 24
    assert len(round_box.points) == 24  # one vertex a point: every edge is smooth
    assert {tuple(normal) for normal in np.abs(sharp.normals).round(6).tolist()} == {
        (1.0, 0.0, 0.0),
        (0.0, 1.0, 0.0),
        (0.0, 0.0, 1.0),
    }


@pytest.mark.parametrize("name", MACHINES)
def test_bodies_of_all_machines_are_closed(name):
    spec = load_shipped_machine(name)
    tracks = spec.tracks
    solids = [solid for link in spec.links for solid in link_solids(spec, link)]
    for part in cylinder_parts(spec):
        solids += cylinder_solids(part, spec.cylinders[part.cylinder])
    for side in (1.0, -1.0):
        solids += [*sprocket_solids(tracks, side), *idler_solids(tracks, side)]
    for solid in [*solids, *shoe_solids(tracks)]:
        assert_closed_and_outward(solid.mesh)


@pytest.mark.parametrize("name", MACHINES)
def test_normals_face_the_side_of_their_triangles(name):
    for mesh in link_meshes(load_shipped_machine(name)).values():
        for group in mesh:
            a, b, c = (group.mesh.points[group.mesh.triangles[:, k]] for k in range(3))
            flat = np.cross(b - a, c - a)
            flat /= np.linalg.norm(flat, axis=1, keepdims=True)
            at_corners = group.mesh.normals[group.mesh.triangles]
            assert np.einsum("ti,tki->tk", flat, at_corners).min() > 0.2


@pytest.mark.parametrize("name", MACHINES)
def test_mesh_of_a_tool_encloses_its_plates(name):
    spec = load_shipped_machine(name)
    for mount in spec.tools.values():
        points = np.concatenate([group.mesh.points for group in link_meshes(spec)[mount.link]])
        plates = np.concatenate(mount.shape.plates())
        margin = 0.02  # the vanes of a drum are drawn as picks between them
        assert (points.min(axis=0) <= plates.min(axis=0) + margin).all()
        assert (points.max(axis=0) >= plates.max(axis=0) - margin).all()
