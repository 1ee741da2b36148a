"""Soil compared with analytic solutions: cones, polygons, slopes, swept volumes.

Shape of a pile by the relaxation radius. Soil slides only along the offsets of the Gauss circle, so
a pile is steepest in their directions, and its contour is the polygon that has a corner, all at the
same distance, in the direction of each offset. This gives the corners, the roundness and the height
of the pile for every radius r::

    r                       1     √2    2     √5    2√2   3     √10   √13   4
    neighbours              4     8     12    20    24    28    36    44    48
    corners                 4     8     8     16    16    16    24    32    32
    axis over diagonal      1.414 1     1     1     1     1     1     1     1
    maximum over minimum r  1.414 1.082 1.082 1.027 1.027 1.027 1.013 1.013 1.013

Table 1 of the reference differs: a square for r = √2, 2 and 2√2, an octagon for √5, √10 and √13,
sixteen edges for 3 and twenty for 4. The reference moves whole units to the steepest neighbour;
here the excess moves to the neighbour where it is largest, and equal excesses alternate. For r = 1
both give a square, here rotated by 45 degrees, and for r = 3 both have sixteen edges. The
conclusion of the reference holds here, too: below √5 a pile has visible edges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from support.soil_scenes import (
    BUCKET_PROFILE,
    NO_DEPOSIT_REQUESTS,
    NO_SWEEPS,
    come_to_rest,
    contour_radii,
    flat_soil,
    make_deposit_requests,
    pour_pile,
    scoop,
)

from msg_bridge.contract.grid import Grid
from soil_sim.slope_failure import gauss_circle_offsets
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.soils.soil_types import load_soil_types

SHIPPED = load_soil_types()


def distances(soil: Soil) -> NDArray[np.float64]:
    """Return the distance of each column from the middle of the map [m]."""
    grid = soil.grid
    return np.hypot(grid.x(np.arange(grid.rows))[:, None], grid.y(np.arange(grid.cols))[None, :])


def flank(along: NDArray[np.float64], height: NDArray[np.float64]) -> tuple[float, float]:
    """Return the angle [deg] of a line fitted to a flank, and its height [m] where `along` is 0.

    The flank is the part from 0.2 to 0.8 of the height, without foot and tip.
    """
    low, high = height.min(), height.max()
    is_flank = (height > low + 0.2 * (high - low)) & (height < low + 0.8 * (high - low))
    fall, apex = np.polyfit(along[is_flank], height[is_flank], 1)
    return math.degrees(math.atan(-fall)), float(apex)


# A cone


@dataclass(frozen=True)
class Heap:
    """A pile at rest, and the cone of its angle [deg] and volume [m^3], lengths [m]."""

    soil: Soil
    angle: float
    volume: float

    @property
    def tangent(self) -> float:
        return math.tan(math.radians(self.angle))

    @property
    def height(self) -> float:
        return float((3 * self.volume * self.tangent**2 / math.pi) ** (1 / 3))

    @property
    def reach(self) -> float:
        return self.height / self.tangent


@pytest.fixture(
    scope="module",
    params=[
        (0.4, 30.0, 150.0),
        (0.4, 34.0, 150.0),
        (0.1, 30.0, 2.4),
        (0.1, 34.0, 2.4),
        (0.05, 30.0, 0.3),
        (0.05, 34.0, 0.3),
        pytest.param((0.05, 30.0, 2.4), marks=[pytest.mark.slow, pytest.mark.independent]),
        pytest.param((0.05, 34.0, 2.4), marks=[pytest.mark.slow, pytest.mark.independent]),
    ],
    ids=lambda p: f"{p[0]}m-{p[1]:.0f}deg-{p[2]}m3",
)
def heap(request: pytest.FixtureRequest) -> Heap:
    cell, angle, volume = request.param
    return Heap(pour_pile(cell, angle, volume, parts=1000), angle, volume)


def test_pile_has_the_angle_of_repose(heap: Heap) -> None:
    angle, _ = flank(distances(heap.soil), heap.soil.columns.height)
    assert angle == pytest.approx(heap.angle, abs=0.5)


def test_pile_has_the_height_of_a_cone_of_its_volume(heap: Heap) -> None:
    _, apex = flank(distances(heap.soil), heap.soil.columns.height)
    # The height goes with the cube root of the volume: 1 % of it is 3 % of the volume.
    assert apex == pytest.approx(heap.height, rel=0.01)


@pytest.mark.parametrize("level", [0.1, 0.5])
def test_contour_radius_along_axis_and_diagonal_is_that_of_the_cone(
    heap: Heap, level: float
) -> None:
    radii = contour_radii(heap.soil, level * heap.height, 8)
    axis, diagonal = radii[::2].mean(), radii[1::2].mean()
    tolerance = 0.02 * heap.reach  # a third of a cell
    assert axis == pytest.approx((1 - level) * heap.reach, abs=tolerance)
    assert diagonal == pytest.approx((1 - level) * heap.reach, abs=tolerance)
    assert axis == pytest.approx(diagonal, abs=tolerance)


def test_pile_is_round(heap: Heap) -> None:
    radii = contour_radii(heap.soil, 0.1 * heap.height, 360)
    assert radii.max() / radii.min() <= 1.03


# The polygon of each relaxation radius


def corners(radius: float) -> NDArray[np.float64]:
    """Return the directions of the offsets of the Gauss circle [rad], from 0 to 2 pi, sorted."""
    offsets = gauss_circle_offsets(radius)
    primitive = offsets[np.gcd(offsets[:, 0], offsets[:, 1]) == 1]
    return np.sort(np.arctan2(primitive[:, 1], primitive[:, 0]) % (2 * math.pi))


def polygon(
    corner_directions: NDArray[np.float64], directions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the radius of a polygon, whose corners have radius 1, in given directions [rad]."""
    index = np.searchsorted(corner_directions, directions, side="right")
    ends = np.append(corner_directions, corner_directions[0] + 2 * math.pi)
    a, b = ends[index - 1], ends[index]
    radii: NDArray[np.float64] = np.sin(b - a) / (np.sin(directions - a) + np.sin(b - directions))
    return radii


@pytest.mark.parametrize(
    ("radius_squared", "count", "axis_over_diagonal", "max_over_min_radius"),
    [
        (1, 4, 1.414, 1.414),
        (2, 8, 1.0, 1.082),
        (4, 8, 1.0, 1.082),
        (5, 16, 1.0, 1.027),
        (8, 16, 1.0, 1.027),
        (9, 16, 1.0, 1.027),
        (10, 24, 1.0, 1.013),
        (13, 32, 1.0, 1.013),
        (16, 32, 1.0, 1.013),
    ],
)
def test_pile_is_the_polygon_of_its_relaxation_radius(
    radius_squared: int, count: int, axis_over_diagonal: float, max_over_min_radius: float
) -> None:
    angle, volume, level = 30.0, 65.0, 0.2  # 47 x 47 points, an odd number: one is the middle
    tangent, radius = math.tan(math.radians(angle)), math.sqrt(radius_squared)
    directions = corners(radius)
    assert directions.size == count
    gaps = np.diff(directions, append=directions[0] + 2 * math.pi)
    reach = float((6 * volume / tangent / np.sin(gaps).sum()) ** (1 / 3))

    soil = pour_pile(0.4, angle, volume, radius, parts=1000)
    radii = contour_radii(soil, level * reach * tangent, 72)
    expected = (1 - level) * reach * polygon(directions, 2 * math.pi * np.arange(72) / 72)
    assert radii == pytest.approx(expected, rel=0.03)
    assert radii.mean() == pytest.approx(expected.mean(), rel=0.01)
    quarters = radii.reshape(4, 18)
    assert quarters == pytest.approx(np.tile(quarters.mean(axis=0), (4, 1)), rel=0.015)
    axis, diagonal = quarters[:, 0].mean(), quarters[:, 9].mean()
    assert axis / diagonal == pytest.approx(axis_over_diagonal, rel=0.02)
    assert radii.max() / radii.min() == pytest.approx(max_over_min_radius, rel=0.02)


# A face, a pit, a scoop


@pytest.mark.parametrize("cell", [0.1, 0.05])
def test_failed_face_rotates_about_its_middle(cell: float) -> None:
    """Without swell, the triangle above the slope that falls is as large as the one it fills."""
    depth, n = 1.0, round(6.0 / cell) + 1
    grid = Grid(n, 21, cell)
    x = grid.x(np.arange(n))
    heights = np.repeat(np.where(x > 0.0, -depth, 0.0)[:, None], 21, axis=1)
    soil = Soil(grid, heights, SoilParams(repose_angle=30.0))
    soil.relaxation.mark_all_disturbed()
    profile = come_to_rest(soil).columns.height.mean(axis=1)
    angle, middle = flank(x, profile)
    face = 0.5 * cell  # x of the face, between the last column above and the first below
    assert angle == pytest.approx(30.0, abs=0.5)
    assert middle - face * math.tan(math.radians(angle)) == pytest.approx(-depth / 2, abs=0.02)
    reach = 0.5 * depth / math.tan(math.radians(30.0))
    has_moved = np.abs(profile - heights[:, 0]) > 0.01 * depth
    assert np.abs(x[has_moved] - face).max() == pytest.approx(reach, abs=1.5 * cell)


@pytest.mark.parametrize("name", ["reference", "dry sand", "dry clay"])
def test_particle_on_the_wall_of_a_pit_moves_only_soil_near_and_below_it(
    name: str,
) -> None:
    grid = Grid(81, 81, 0.2)
    x = grid.x(np.arange(81))
    across = np.maximum(np.abs(x[:, None]), np.abs(x[None, :]))
    kind = SHIPPED[name]
    soil = Soil(grid, np.where(across < 3.0, -1.5, 0.0), SoilParams(soil=name))
    soil.relaxation.mark_all_disturbed()
    come_to_rest(soil)
    shape = soil.columns.height.copy()
    assert np.ptp(shape) == pytest.approx(1.5, abs=0.01), "the whole wall is at its limit"
    wall = np.argwhere((shape > -1.3) & (shape < -0.2))
    if not wall.size:  # a vertical wall has no columns on it
        wall = np.argwhere((across > 2.7) & (across < 3.0))
    rng = np.random.default_rng(1)
    for tick, (row, col) in enumerate(rng.permutation(wall)[:40]):
        before = soil.columns.height.copy()
        rows = make_deposit_requests(grid.x(row), grid.y(col), 1_000_000)
        rows["moisture"] = kind.moisture
        soil.step(tick, NO_SWEEPS, rows)
        come_to_rest(soil)
        moved = np.argwhere(soil.columns.height != before)
        assert 1 <= len(moved) <= 40
        assert np.hypot(*(moved - (row, col)).T).max() <= 15
        above = before > before[row, col] + 1e-9
        assert (soil.columns.height[above] >= before[above]).all(), "soil above it stays"
    rim = (across > 3.0) & (shape > -0.01)
    assert (soil.columns.height[rim] == shape[rim]).all()


def swept_area(path: list[tuple[float, float]], cell: float = 0.004) -> float:
    """Return the area below z = 0 that a bucket sweeps along a path of its lip (x, z) [m^2]."""
    x, z = np.meshgrid(np.arange(-3.0, 2.0, cell), np.arange(-1.0, 0.0, cell), indexing="ij")
    swept = np.zeros(x.shape, dtype=bool)
    profile = np.array(BUCKET_PROFILE, dtype=float)
    for start, end in pairwise(np.array(path)):
        move = end - start
        for a, b in pairwise(profile):
            edge = b - a
            area = edge[0] * move[1] - edge[1] * move[0]
            if abs(area) > 1e-12:
                px, pz = x - (start + a)[0], z - (start + a)[1]
                u = (px * move[1] - pz * move[0]) / area
                v = (edge[0] * pz - edge[1] * px) / area
                swept |= (u >= 0) & (u <= 1) & (v >= 0) & (v <= 1)
    return float(swept.sum()) * cell**2


@pytest.mark.parametrize(("depth", "length"), [(0.3, 1.5), (0.15, 2.0)])
def test_scoop_excavates_the_swept_volume_on_every_grid(depth: float, length: float) -> None:
    excavated = [
        scoop(flat_soil(6.0, cell), depth=depth, length=length) / 1e9 for cell in (0.2, 0.1, 0.05)
    ]
    half = length / 2
    path = [(-half, 0.02), (-half, -depth), (half, -depth), (half, 0.3)]
    assert max(excavated) / min(excavated) <= 1.05
    assert excavated == pytest.approx([1.2 * swept_area(path)] * 3, rel=0.02)


# Shipped soils


@pytest.mark.parametrize("name", SHIPPED)
def test_pile_of_every_shipped_soil_has_its_angle_of_repose(name: str) -> None:
    kind, reach, parts = SHIPPED[name], 2.0, 600
    angle = kind.repose_angle_at(kind.moisture)
    volume = math.pi / 3 * math.tan(angle) * reach**3
    soil = flat_soil(3.2 * reach, 0.1, soil=name)
    rows = make_deposit_requests(0.0, 0.0, round(volume * 1e9 / (1 + kind.swell) / parts))
    rows["moisture"] = kind.moisture
    for tick in range(parts):
        soil.step(tick, NO_SWEEPS, rows)
    come_to_rest(soil)
    measured, apex = flank(distances(soil), soil.columns.height)
    assert measured == pytest.approx(math.degrees(angle), abs=0.5)
    assert apex == pytest.approx(reach * math.tan(angle), rel=0.02)


@pytest.mark.parametrize("moisture", [0, 25, 75, 100])
def test_pile_of_sand_has_the_angle_of_its_moisture(moisture: int) -> None:
    kind, reach, parts = SHIPPED["dry sand"], 2.0, 600
    angle = kind.repose_angle_at(moisture)
    soil = flat_soil(3.2 * reach, 0.1, soil="dry sand", moisture=moisture)
    rows = make_deposit_requests(
        0.0, 0.0, round(math.pi / 3 * math.tan(angle) * reach**3 * 1e9 / parts)
    )
    rows["moisture"] = moisture
    for tick in range(parts):
        soil.step(tick, NO_SWEEPS, rows)
    soil.step(parts, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
    measured, _ = flank(distances(come_to_rest(soil)), soil.columns.height)
    assert measured == pytest.approx(math.degrees(angle), abs=0.5)
