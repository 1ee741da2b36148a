"""The registry of tool kinds, and a blade as a kind that no shipped machine has."""

from pathlib import Path

import numpy as np
import pytest
from support.machine_scenes import level_soil, loose_soil_options, machine_on_level_ground

from earthmoving_sim.world import World
from machine_sim.machine import MachineError, load_machine_spec
from machine_sim.machine.tools.blade import BladeShape
from machine_sim.machine.tools.shapes import TOOL_SHAPES
from machine_sim.tool_soil.payload import EMPTY_PAYLOAD
from machine_sim.tool_soil.tools import TOOL_INTERACTIONS

BLADED_MACHINE = Path(__file__).with_name("bladed_machine.yaml")
PROFILE = [[0.1, 0.0], [0.0, 0.3], [0.0, 0.6], [0.1, 0.9]]


def test_each_kind_has_a_shape_and_an_interaction() -> None:
    assert set(TOOL_SHAPES) == set(TOOL_INTERACTIONS)


def test_blade_compacts_along_the_normals_of_its_back() -> None:
    normals = BladeShape(np.array(PROFILE), 2.8).outward_normals
    assert (normals[:, 0] < 0.0).all()
    assert np.linalg.norm(normals, axis=1) == pytest.approx(1.0)


def test_blade_releases_soil_ahead_of_its_plate() -> None:
    blade = BladeShape(np.array(PROFILE), 2.8)
    points = np.random.default_rng(0).uniform(-2.0, 2.0, (200, 3))
    released = blade.release_points(points, 0.02, np.array([0.0, 0.0, 1.0]))
    x, z = blade.profile.T
    assert (released[:, 0] >= np.interp(released[:, 2], z, x) + 0.019).all()
    assert (np.abs(released[:, 1]) <= 1.38).all()


@pytest.mark.parametrize(
    "change", [{"profile": [[0.0, 0.0], [0.1, -0.2]]}, {"profile": [[0.0, 0.0]]}, {"width": 0.0}]
)
def test_invalid_blade_is_rejected(change) -> None:
    with pytest.raises(MachineError):
        BladeShape(**{"profile": PROFILE, "width": 2.8, **change})


def test_blade_digs_pushes_soil_and_keeps_the_volume() -> None:
    soil = level_soil(soil="loam")
    sim = machine_on_level_ground(load_machine_spec(BLADED_MACHINE), **loose_soil_options(soil))
    world = World(soil, {1: sim})
    sim.command(np.zeros(1), np.full(2, 0.6))
    for _ in range(400):
        assert world.step().imbalance == 0
    assert sim.particles.total_volume_mm3 > 100 * sim.particles.params.nominal_volume
    assert sim.tool_coupling.wrench[0][0] < -1e3, "the soil pushes the blade back"
    assert sim.payload == EMPTY_PAYLOAD
    sim.close()
