"""Geometry and URDF of the running gear of the dynamic tracks."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from machine_sim.machine import MachineError, with_track_model
from machine_sim.machine.tracks.running_gear import (
    initial_shoe_poses,
    urdf_with_running_gear,
    with_dynamic_tracks,
)
from machine_sim.machine.visuals import shoe_visual


def altered(spec, **tracks):
    return with_dynamic_tracks(replace(spec, tracks=replace(spec.tracks, **tracks)))


def test_excavator_has_24_dynamic_shoes_on_each_side(spec):
    tracks = with_track_model(spec, "dynamic").tracks
    assert tracks.shoe_count == 24
    assert tracks.sprocket_radius == pytest.approx(spec.tracks.sprocket_radius, rel=0.05)


def test_kinematic_tracks_leave_the_specification_unchanged(spec):
    assert with_track_model(spec, "kinematic") is spec


def test_conversion_to_dynamic_tracks_is_idempotent(spec):
    once = with_dynamic_tracks(spec)
    assert with_dynamic_tracks(once).tracks == once.tracks


def test_stiffness_of_the_belt_does_not_depend_on_the_number_of_shoes(spec):
    tracks, dynamic = spec.tracks, with_dynamic_tracks(spec).tracks
    for name in ("normal_stiffness", "tangential_stiffness", "normal_damping"):
        total = getattr(tracks, name) * tracks.shoe_count
        assert getattr(dynamic, name) * dynamic.shoe_count == pytest.approx(total)


@pytest.mark.parametrize(("axles", "radius"), [(3.144, 0.36), (2.6, 0.3), (4.2, 0.36)])
def test_new_chain_is_closed_and_its_soles_are_on_the_ground(spec, axles, radius):
    shape = altered(spec, axle_distance=axles, sprocket_radius=radius).tracks
    x, z, pitch = initial_shoe_poses(shape).T
    ahead = 0.5 * shape.sprocket_radius * np.column_stack([np.cos(pitch), -np.sin(pitch)])
    middles = np.column_stack([x, z])
    np.testing.assert_allclose(middles + ahead, np.roll(middles - ahead, -1, axis=0), atol=1e-12)
    assert len(x) == shape.shoe_count
    assert z.min() == pytest.approx(0.5 * shape.shoe_thickness)


def test_mass_of_shoes_and_wheels_is_subtracted_from_the_base(spec):
    dynamic = with_dynamic_tracks(spec)
    masses = {
        link.attrib["name"]: float(link.find("inertial/mass").attrib["value"])
        for link in ET.fromstring(urdf_with_running_gear(dynamic)).iter("link")
    }
    total = sum(masses.values()) + 2.0 * spec.tracks.belt_mass
    assert total == pytest.approx(spec.mass)
    assert masses["base_link"] < spec.links["base"].mass


def test_visual_and_tracks_have_equal_numbers_of_shoes(scene):
    machine = scene(tracks="dynamic").machine
    assert shoe_visual(machine.spec).shoe_count == machine.tracks.shoe_poses.shape[1]


def test_base_lighter_than_its_tracks_is_rejected(spec):
    with pytest.raises(MachineError, match=r"base\.mass is 8000\.0 kg.*heavier base or a lighter"):
        urdf_with_running_gear(altered(spec, belt_mass=3500.0))


def test_shoes_too_thick_for_the_sprocket_are_rejected(spec):
    with pytest.raises(MachineError, match=r"shoe_thickness is 0\.7 m, too thick .* thinner"):
        urdf_with_running_gear(altered(spec, shoe_thickness=0.7))
