"""Geometry and URDF of the hinged tracks' running gear."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from machine_sim.machine import MachineError, fitted_with
from machine_sim.machine.appearance import shoe_look
from machine_sim.machine.tracks.gear import chain_poses, machine_urdf, with_hinged_tracks


def altered(description, **tracks):
    return with_hinged_tracks(replace(description, tracks=replace(description.tracks, **tracks)))


def test_shipped_machine_has_24_shoes_a_side(description):
    tracks = fitted_with(description, "physics").tracks
    assert tracks.shoe_count == 24
    assert tracks.sprocket_radius == pytest.approx(description.tracks.sprocket_radius, rel=0.05)


def test_fast_tracks_are_those_of_the_description(description):
    assert fitted_with(description, "fast") is description


def test_machine_fitted_twice_is_as_fitted_once(description):
    once = with_hinged_tracks(description)
    assert with_hinged_tracks(once).tracks == once.tracks


def test_ground_carries_a_belt_as_stiffly_whatever_its_shoes(description):
    shape, hinged = description.tracks, with_hinged_tracks(description).tracks
    for name in ("normal_stiffness", "tangential_stiffness", "normal_damping"):
        whole = getattr(shape, name) * shape.shoe_count
        assert getattr(hinged, name) * hinged.shoe_count == pytest.approx(whole)


@pytest.mark.parametrize(("axles", "radius"), [(3.144, 0.36), (2.6, 0.3), (4.2, 0.36)])
def test_new_chain_is_closed_and_rests_on_the_ground(description, axles, radius):
    shape = altered(description, axle_distance=axles, sprocket_radius=radius).tracks
    x, z, pitch = chain_poses(shape).T
    ahead = 0.5 * shape.sprocket_radius * np.column_stack([np.cos(pitch), -np.sin(pitch)])
    middles = np.column_stack([x, z])
    np.testing.assert_allclose(middles + ahead, np.roll(middles - ahead, -1, axis=0), atol=1e-12)
    assert len(x) == shape.shoe_count
    assert z.min() == pytest.approx(0.5 * shape.shoe_thickness)


def test_base_is_lighter_by_shoes_and_wheels(description):
    hinged = with_hinged_tracks(description)
    masses = {
        link.attrib["name"]: float(link.find("inertial/mass").attrib["value"])
        for link in ET.fromstring(machine_urdf(hinged)).iter("link")
    }
    whole = sum(masses.values()) + 2.0 * description.tracks.belt_mass
    assert whole == pytest.approx(description.mass)
    assert masses["base_link"] < description.links["base"].mass


def test_look_has_as_many_shoes_as_there_are(scene):
    machine = scene(tracks="physics").machine
    assert shoe_look(machine.description).shoe_count == machine.tracks.shoe_poses.shape[1]


def test_base_lighter_than_its_tracks_is_refused(description):
    with pytest.raises(MachineError, match=r"base\.mass is 7000\.0 kg.*heavier base or a lighter"):
        machine_urdf(altered(description, belt_mass=3000.0))


def test_shoes_too_thick_for_the_sprocket_are_refused(description):
    with pytest.raises(MachineError, match=r"shoe_thickness is 0\.7 m, too thick .* thinner"):
        machine_urdf(altered(description, shoe_thickness=0.7))
