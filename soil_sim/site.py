"""The site a node begins with: from a file, or made."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.parameters import Parameters, parameter
from soil_sim.terrain import HeightMap, flat, load_terrain, rough

__all__ = ["SiteParams", "make_site"]


@dataclass(frozen=True)
class SiteParams(Parameters):
    """Where the ground comes from."""

    terrain: str = parameter(
        "rough", "flat, rough, or the path of a .npy, .npz, .png, .asc or .tif file"
    )
    cell: float = parameter(
        0.2,
        "spacing of grid points of made ground, and of a file that states none",
        unit="m",
        low=0.01,
        high=1000.0,
    )
    points: int = parameter(257, "grid points along each side of made ground", low=2, high=8193)
    roughness: float = parameter(
        0.1, "root mean square height of rough ground", unit="m", low=0.0, high=10.0
    )
    seed: int = parameter(0, "of rough ground", low=0, high=2**31)
    lowest: float = parameter(0.0, "height of black in a .png", unit="m", low=-9000.0, high=9000.0)
    highest: float = parameter(
        0.0, "height of white in a .png; equal to lowest: none given", unit="m",
        low=-9000.0, high=9000.0,
    )  # fmt: skip


_CORRELATION_LENGTH = 4.0
"""Of rough ground [m]: hummocks about as large as a machine."""


def make_site(params: SiteParams) -> HeightMap:
    """The ground that the parameters name.

    Raises:
        TerrainError: the file is missing or cannot be ground.
    """
    if params.terrain not in ("flat", "rough"):
        given = params.highest != params.lowest
        heights = (params.lowest, params.highest) if given else None
        suffix = params.terrain.rpartition(".")[2].lower()
        # A file that states its spacing keeps it.
        cell = params.cell if suffix in ("npy", "png") else None
        return load_terrain(params.terrain, cell=cell, height_range=heights)
    grid = Grid(params.points, params.points, params.cell)
    if params.terrain == "flat" or params.roughness == 0.0:
        return flat(grid)
    length = min(max(_CORRELATION_LENGTH, grid.cell), min(grid.size))
    rng = np.random.default_rng(params.seed)
    return rough(grid, rms=params.roughness, correlation_length=length, rng=rng)
