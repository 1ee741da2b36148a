"""Figure 5: piles of soil deposited at one point, by relaxation over neighbours within r."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from earthmoving_sim.figures.figure import Figure
from earthmoving_sim.figures.soil_scene import SoilScene
from earthmoving_sim.figures.studio import Studio
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import DEPOSIT_REQUEST, SWEEP, Rows, empty_rows
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from viewer.rendering.camera import PoseCamera

__all__ = ["piles_at_a_point"]

_GRID = Grid(129, 129, 0.1)
_VOLUME_MM3 = 4_000_000
_NUM_DEPOSITS = 1500
_RADII = (("a", 1.0), ("b", 2.3), ("c", 4.0))
"""Letters of the pictures, and the radii r of relaxation [cells]."""

_CAMERA = PoseCamera((3.6, -4.6, 4.2), (0.0, 0.0, 0.35), fov=42.0)


def piles_at_a_point(studio: Studio) -> list[Figure]:
    """Figure 5: the same deposits with r = 1, 2.3 and 4."""
    figure = Figure(
        5,
        "Pile of soil with r = 2.3",
        "The same volume is deposited at one point of level ground of a soil with an angle of"
        " repose of 30 deg. Soil moves to neighbours within the radius r. With r below √5 the"
        " pile is not round; the default is 4.",
    )
    for letter, radius in _RADII:
        soil = make_pile(radius)
        with studio.photograph(SoilScene(soil)) as photographer:
            caption = f"({letter}) r = {radius:g}"
            figure.pictures.append(photographer.take(_CAMERA, f"figure_05{letter}", caption))
        height, roundness = soil.columns.height, measure_roundness(soil)
        figure.measurements[f"r = {radius:g}"] = (
            f"height {height.max():.2f} m, ratio of largest to smallest radius {roundness:.2f}"
        )
    return [figure]


def make_pile(radius: float) -> Soil:
    """Return a pile of deposits at one point.

    Args:
        radius: radius r of the neighbourhood that soil moves to [cells].
    """
    params = SoilParams(repose_angle=30.0, swell=0.0, relaxation_radius=radius)
    soil = Soil(_GRID, np.zeros(_GRID.shape), params)
    for tick in range(_NUM_DEPOSITS):
        soil.step(tick, empty_rows(SWEEP), _deposit())
    for tick in range(_NUM_DEPOSITS, _NUM_DEPOSITS + 200):
        soil.step(tick, empty_rows(SWEEP), empty_rows(DEPOSIT_REQUEST))
    return soil


def measure_roundness(soil: Soil) -> float:
    """Return the ratio of largest to smallest radius of a pile at half its height."""
    height = soil.columns.height
    x, y = _GRID.x(np.arange(_GRID.rows)), _GRID.y(np.arange(_GRID.cols))
    radii = [
        _half_height_radius(height, x, y, angle)
        for angle in np.linspace(0.0, 2.0 * math.pi, 72, endpoint=False)
    ]
    return max(radii) / min(radii)


def _half_height_radius(
    height: NDArray[np.float64], x: NDArray[np.float64], y: NDArray[np.float64], angle: float
) -> float:
    """Return the distance from the middle at which a pile has half its height [m]."""
    distance = np.arange(0.0, 0.45 * _GRID.rows * _GRID.cell, 0.1 * _GRID.cell)
    row = (x[0] - distance * math.cos(angle)) / _GRID.cell
    col = (y[0] - distance * math.sin(angle)) / _GRID.cell
    r, c = row.astype(int), col.astype(int)
    near = height[r, c] + (col - c) * (height[r, c + 1] - height[r, c])
    far = height[r + 1, c] + (col - c) * (height[r + 1, c + 1] - height[r + 1, c])
    along = near + (row - r) * (far - near)
    return float(distance[np.flatnonzero(along >= 0.5 * along[0])[-1]])


def _deposit() -> Rows:
    rows = empty_rows(DEPOSIT_REQUEST, 1)
    rows["volume_mm3"], rows["machine_id"], rows["particle_id"] = _VOLUME_MM3, 1, 1
    return rows
