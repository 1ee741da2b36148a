"""Track compaction, from changes of height and bank volume of the columns."""

from __future__ import annotations

import numpy as np
import pytest

from machine_sim.ground.contact_surface import Ground
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.rows import MAP_UPDATE, empty_rows

GRID = Grid(11, 9, 0.5)
AT = (3, 4)


def loose_ground() -> Ground:
    ground = Ground(GRID, np.zeros(GRID.shape), soils=[LooseSoil(swell=0.25)])
    ground.apply_keyframe(keyframe(np.zeros(GRID.shape), np.full(GRID.shape, 10 * 10**9)))
    return ground


def keyframe(elevation: np.ndarray, volume: np.ndarray) -> Keyframe:
    return Keyframe(1, 1, GRID, elevation, volume.astype(np.int64))


def update(ground: Ground, rise: float, added: float) -> None:
    """Raise the column by `rise` [m] with a change of bank height of `added` [m]."""
    rows = empty_rows(MAP_UPDATE, 1)
    rows["row"], rows["col"] = AT
    rows["z"] = ground.elevation[AT] + rise
    rows["volume_mm3"] = ground.volume_mm3[AT] + added * 1e9 * GRID.cell**2
    ground.apply_changes(rows)
    ground.advance(10.0)


def test_lowered_column_with_unchanged_volume_is_compacted() -> None:
    ground = loose_ground()
    update(ground, -0.05, 0.0)
    assert ground.surface[AT] == pytest.approx(-0.05)
    assert ground.undisturbed_surface[AT] == pytest.approx(0.0, abs=1e-6)
    assert ground.max_sinkage[AT] == pytest.approx(0.05)


def test_excavated_column_is_not_compacted() -> None:
    ground = loose_ground()
    update(ground, -0.4, -0.4)
    update(ground, -0.25, -0.2)  # loose soil of larger volume
    assert ground.undisturbed_surface[AT] == ground.surface[AT] == pytest.approx(-0.65)
    assert ground.max_sinkage[AT] == 0.0


def test_column_of_unknown_volume_is_not_compacted() -> None:
    ground = Ground(GRID, np.zeros(GRID.shape))
    ground.set_heights(np.array([3]), np.array([4]), np.array([-0.1]))
    assert ground.undisturbed_surface[AT] == ground.surface[AT] == -0.1


def test_simultaneous_excavation_and_compaction_are_separated() -> None:
    ground = loose_ground()
    update(ground, -0.15, -0.08)  # at most 0.1 m of loose soil was removed
    assert ground.undisturbed_surface[AT] == pytest.approx(-0.1)
    assert ground.max_sinkage[AT] == pytest.approx(0.05)


def test_soil_added_to_a_rut_fills_it() -> None:
    ground = loose_ground()
    update(ground, -0.05, 0.0)
    update(ground, 0.02, 0.016)
    assert ground.undisturbed_surface[AT] == pytest.approx(0.0, abs=1e-6)
    assert ground.max_sinkage[AT] == pytest.approx(0.03)
    update(ground, 0.05, 0.04)
    assert ground.undisturbed_surface[AT] == ground.surface[AT] == pytest.approx(0.02)
    assert ground.max_sinkage[AT] == 0.0


def test_excavation_of_a_rut_clears_its_compaction() -> None:
    ground = loose_ground()
    update(ground, -0.05, 0.0)
    update(ground, -0.3, -0.3)
    assert ground.undisturbed_surface[AT] == ground.surface[AT] == pytest.approx(-0.35)
    assert ground.max_sinkage[AT] == 0.0


def test_keyframe_updates_compaction_like_map_updates() -> None:
    ground = loose_ground()
    elevation, volume = np.zeros(GRID.shape), np.full(GRID.shape, 10.0 * 10**9)
    elevation[AT] = -0.05
    elevation[5, 5], volume[5, 5] = -0.3, 10e9 - 0.3e9 * GRID.cell**2
    ground.apply_keyframe(keyframe(elevation, volume))
    assert ground.undisturbed_surface[AT] == pytest.approx(0.0, abs=1e-6)
    assert ground.undisturbed_surface[5, 5] == pytest.approx(-0.3)
