"""The side length of cells is recovered from float32 positions."""

from __future__ import annotations

import numpy as np
import pytest
from builtin_interfaces.msg import Time

from msg_bridge.codec.terrain import TerrainMap, from_terrain_cloud, to_terrain_cloud
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe

SHAPES = [(2, 3), (65, 64), (257, 31)]
FOOT = 0.3048006096  # US survey foot [m]


def read_cell(cell: float, shape: tuple[int, int]) -> float:
    grid = Grid(*shape, cell)
    level = np.zeros(shape)
    terrain = TerrainMap(Keyframe(1, 0, grid, level), level)
    return from_terrain_cloud(to_terrain_cloud(terrain, "map", Time())).keyframe.grid.cell


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("cell", [1.0 / 3.0, FOOT, 0.1234567, np.pi])
def test_cell_size_of_many_digits_is_estimated_to_float32_precision(
    cell: float, shape: tuple[int, int]
) -> None:
    assert read_cell(cell, shape) == pytest.approx(cell, rel=2e-7)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("cell", [0.01, 0.05, 0.1, 0.2, 0.3, 1.0, 12.5, 30.0, 0.123456])
def test_cell_size_of_few_digits_is_estimated_exactly(cell: float, shape: tuple[int, int]) -> None:
    assert read_cell(cell, shape) == cell


def test_any_cell_size_is_estimated() -> None:
    rng = np.random.default_rng(0)
    for cell in 10.0 ** rng.uniform(-2.0, 2.9, 50):
        for shape in SHAPES:
            assert read_cell(float(cell), shape) == pytest.approx(cell, rel=2e-7)
