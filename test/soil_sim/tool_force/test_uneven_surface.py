"""Force of a blade before a berm, a bank or a ditch: the trial wedge of least resistance."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from support.soil_scenes import NO_DEPOSIT_REQUESTS, tool_sweep

from msg_bridge.contract.constants import GRAVITY
from msg_bridge.contract.grid import Grid
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.soils.soil_types import load_soil_types

SAND = load_soil_types()["dry sand"]
PHI, DELTA = math.radians(SAND.internal_friction), math.radians(SAND.tool_friction)
WIDTH, DEPTH, EDGE = 20.0, 0.4, -6.0
"""Width of a blade beside which the ends hardly count, depth and position x of its edge [m]."""

Surface = Callable[[np.ndarray], np.ndarray]
"""Height of the surface [m] at a distance ahead of the edge [m]."""


def berm(s: np.ndarray) -> np.ndarray:
    """A berm of 0.3 m that falls at the angle of repose, on level ground."""
    return np.clip(0.3 - np.tan(PHI) * np.maximum(s - 0.1, 0.0), 0.0, 0.3)


def bank(s: np.ndarray) -> np.ndarray:
    return np.clip(0.5 * (s - 0.5), 0.0, 0.25)


def ditch(s: np.ndarray) -> np.ndarray:
    return -np.clip(0.6 * (s - 0.6), 0.0, 0.2)


def min_push(surface: Surface, rake: float) -> float:
    """Return the push on the plane of least resistance over weight and width [m^2]."""
    s = np.linspace(0.0, 4.0, 4001)
    h = surface(s) + DEPTH
    area = np.concatenate([[0.0], np.cumsum(0.5 * (h[1:] + h[:-1]) * np.diff(s))])
    area += 0.5 * h[0] ** 2 / math.tan(rake)
    plane = np.arctan2(h[100:], s[100:])
    weight = area[100:] - 0.5 * h[100:] * s[100:]
    turned = rake + DELTA + PHI + plane
    push = weight * np.sin(plane + PHI) / np.sin(turned)
    return float(push[turned < 0.95 * np.pi].min())


def force(
    surface: Surface, outline: Sequence[tuple[float, float]], cell: float = 0.05
) -> np.ndarray:
    """Return the force on a tool that moves toward +x, its edge at `EDGE` and `DEPTH`.

    Soil above z = 0 is loose, at the density of firm soil.
    """
    grid = Grid(round(16.0 / cell) + 1, round(24.0 / cell) + 1, cell)
    s = np.asarray(grid.x(np.arange(grid.rows))) - EDGE
    heights = np.repeat(surface(np.maximum(s, 0.0))[:, None], grid.cols, axis=1)
    soil = Soil(grid, heights, SoilParams(soil="dry sand"))
    columns = soil.columns
    loose = np.int64(np.maximum(heights, 0.0) / columns.metres_per_mm3).reshape(columns.loose.shape)
    columns.firm -= loose
    columns.loose += loose
    columns.bulk += loose
    start, end = (EDGE - 0.02, 0.0, -DEPTH), (EDGE, 0.0, -DEPTH)
    row = soil.step(0, tool_sweep(outline, start, end, WIDTH), NO_DEPOSIT_REQUESTS).forces[0]
    return np.array([row["fx"], row["fy"], row["fz"]], dtype=np.float64)


def plate(rake: float) -> list[tuple[float, float]]:
    """Return the outline of a plate of 1.2 m at a rake [rad]."""
    return [(0.0, 0.0), (-1.2 * math.cos(rake), 1.2 * math.sin(rake))]


@pytest.mark.parametrize("cell", [0.05, 0.1])
@pytest.mark.parametrize("rake", [45.0, 60.0, 75.0])
@pytest.mark.parametrize("surface", [berm, bank, ditch])
def test_force_is_that_of_the_plane_of_least_resistance(surface, rake, cell) -> None:
    outline, angle = plate(math.radians(rake)), math.radians(rake)
    ratio = force(surface, outline, cell)[0] / force(np.zeros_like, outline, cell)[0]
    assert ratio == pytest.approx(min_push(surface, angle) / min_push(np.zeros_like, angle), 0.05)


def test_curved_plate_has_the_rake_of_its_chord_and_carries_the_soil_over_it() -> None:
    """A plate with a fold at half the depth, that ends high above the ground.

    As a bucket, it bears the weight of the soil between its face and the vertical through the edge
    as the weight of particles: the ground does not press that weight on it again.
    """
    fold, rise = (-0.30, 0.5 * DEPTH), DEPTH / 0.10
    curved = [(0.0, 0.0), fold, (fold[0] - 1.0 / rise, fold[1] + 1.0)]
    at_surface = (fold[0] - 0.5 * DEPTH / rise, DEPTH)
    chord = math.atan2(at_surface[1], -at_surface[0])
    carried = 0.5 * DEPTH * -at_surface[0] * WIDTH * SAND.density * GRAVITY
    assert force(np.zeros_like, curved) == pytest.approx(
        force(np.zeros_like, plate(chord)) + np.array([0.0, 0.0, carried]), rel=1e-3, abs=1.0
    )
