"""What the ground remembers of tracks, by what the soil tells of its columns."""

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


def tell(ground: Ground, rise: float, came: float) -> None:
    """The soil tells that the column rose by `rise` as `came` of bank soil came, both [m]."""
    rows = empty_rows(MAP_UPDATE, 1)
    rows["row"], rows["col"] = AT
    rows["z"] = ground.elevation[AT] + rise
    rows["volume_mm3"] = ground.volume_mm3[AT] + came * 1e9 * GRID.cell**2
    ground.apply_changes(rows)
    ground.advance(10.0)


def test_a_column_that_falls_with_all_its_soil_was_pressed() -> None:
    ground = loose_ground()
    tell(ground, -0.05, 0.0)
    assert ground.surface[AT] == pytest.approx(-0.05)
    assert ground.undisturbed_surface[AT] == pytest.approx(0.0, abs=1e-6)
    assert ground.max_sinkage[AT] == pytest.approx(0.05)


def test_one_that_is_dug_was_not() -> None:
    ground = loose_ground()
    tell(ground, -0.4, -0.4)
    tell(ground, -0.25, -0.2)  # loose soil, that took more room
    assert ground.undisturbed_surface[AT] == ground.surface[AT] == pytest.approx(-0.65)
    assert ground.max_sinkage[AT] == 0.0


def test_one_whose_volume_is_not_known_was_not() -> None:
    ground = Ground(GRID, np.zeros(GRID.shape))
    ground.set_heights(np.array([3]), np.array([4]), np.array([-0.1]))
    assert ground.undisturbed_surface[AT] == ground.surface[AT] == -0.1


def test_what_is_dug_while_it_is_pressed_is_told_apart() -> None:
    ground = loose_ground()
    tell(ground, -0.15, -0.08)  # at most 0.1 m of it went
    assert ground.undisturbed_surface[AT] == pytest.approx(-0.1)
    assert ground.max_sinkage[AT] == pytest.approx(0.05)


def test_soil_that_falls_into_a_rut_fills_it_and_is_no_hill() -> None:
    ground = loose_ground()
    tell(ground, -0.05, 0.0)
    tell(ground, 0.02, 0.016)
    assert ground.undisturbed_surface[AT] == pytest.approx(0.0, abs=1e-6)
    assert ground.max_sinkage[AT] == pytest.approx(0.03)
    tell(ground, 0.05, 0.04)
    assert ground.undisturbed_surface[AT] == ground.surface[AT] == pytest.approx(0.02)
    assert ground.max_sinkage[AT] == 0.0


def test_a_rut_that_is_dug_away_is_forgotten() -> None:
    ground = loose_ground()
    tell(ground, -0.05, 0.0)
    tell(ground, -0.3, -0.3)
    assert ground.undisturbed_surface[AT] == ground.surface[AT] == pytest.approx(-0.35)
    assert ground.max_sinkage[AT] == 0.0


def test_a_keyframe_is_followed_like_changes() -> None:
    ground = loose_ground()
    elevation, volume = np.zeros(GRID.shape), np.full(GRID.shape, 10.0 * 10**9)
    elevation[AT] = -0.05
    elevation[5, 5], volume[5, 5] = -0.3, 10e9 - 0.3e9 * GRID.cell**2
    ground.apply_keyframe(keyframe(elevation, volume))
    assert ground.undisturbed_surface[AT] == pytest.approx(0.0, abs=1e-6)
    assert ground.undisturbed_surface[5, 5] == pytest.approx(-0.3)
