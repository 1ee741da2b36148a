"""Initial site of a run: terrain from a file or synthetic, its soil layers, and its design."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.parameters import Parameters, parameter
from soil_sim.errors import SoilError, TerrainError
from soil_sim.site.cut_fill import DEFAULT_TOLERANCE, CutFill, compare_to_design
from soil_sim.site.design import DesignSurface, load_design
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.terrain import (
    Georeference,
    HeightMap,
    Layers,
    flat,
    load_layer,
    load_terrain,
    load_terrain_with_layers,
    rough,
)

__all__ = ["Site", "SiteParams", "make_site"]

T = TypeVar("T")


@dataclass(frozen=True)
class SiteParams(Parameters):
    """Sources of terrain, soil layers and design."""

    terrain: str = parameter(
        "rough", "flat, rough, or the path of a .npy, .npz, .png, .asc or .tif file"
    )
    cell: float = parameter(
        0.2,
        "grid spacing of synthetic terrain, and of a file that states none",
        unit="m",
        low=0.01,
        high=1000.0,
    )
    num_points: int = parameter(
        257, "grid points along each side of synthetic terrain", low=2, high=8193
    )
    roughness: float = parameter(
        0.1, "root mean square height of rough terrain", unit="m", low=0.0, high=10.0
    )
    seed: int = parameter(0, "seed of rough terrain", low=0, high=2**31)
    png_min_height: float = parameter(
        0.0, "height of black in a .png", unit="m", low=-9000.0, high=9000.0
    )
    png_max_height: float = parameter(
        0.0, "height of white in a .png; equal to png_min_height: not given", unit="m",
        low=-9000.0, high=9000.0,
    )  # fmt: skip
    vertical_scale: float = parameter(
        1.0, "metres per unit of the heights in the files terrain and design; 0.3048 for feet",
        low=1e-6, high=1e6,
    )  # fmt: skip
    soil_map: str = parameter(
        "", "path of a file with the soil id of each cell; empty: the array soil of a .npz terrain,"
        " else 0 everywhere",
    )  # fmt: skip
    moisture_map: str = parameter(
        "", "path of a file with the moisture of each cell, 0..100 % of saturation; empty: the"
        " array moisture of a .npz terrain, else the moisture of the soil",
    )  # fmt: skip
    design: str = parameter("", "path of a file with the design surface; empty: none")
    design_tolerance: float = parameter(
        DEFAULT_TOLERANCE,
        "maximum difference from the design of a finished cell",
        unit="m",
        low=0.0,
        high=10.0,
    )

    @property
    def is_synthetic(self) -> bool:
        """Whether the terrain is not read from a file."""
        return self.terrain in ("flat", "rough")

    @property
    def files(self) -> dict[str, str]:
        """Paths of the files that are read, by the name of their parameter."""
        terrain = "" if self.is_synthetic else self.terrain
        paths = {
            "terrain": terrain,
            "soil_map": self.soil_map,
            "moisture_map": self.moisture_map,
            "design": self.design,
        }
        return {name: path for name, path in paths.items() if path}


@dataclass(frozen=True, eq=False)
class Site:
    """Initial state of the terrain of a run.

    Attributes:
        ground: heights and georeference of the terrain.
        layers: soil ids and moisture, on the grid of the terrain.
        design: design surface, on the grid of the terrain; None without one.
        tolerance: maximum difference from the design of a finished cell [m].
    """

    ground: HeightMap
    layers: Layers = field(default_factory=Layers)
    design: DesignSurface | None = None
    tolerance: float = DEFAULT_TOLERANCE

    @property
    def grid(self) -> Grid:
        """Grid of the columns."""
        return self.ground.grid

    @property
    def heights(self) -> NDArray[np.float64]:
        """Height of the surface [m], shape (rows, cols)."""
        return self.ground.heights

    @property
    def georeference(self) -> Georeference | None:
        """Georeference of the terrain, None without one."""
        return self.ground.georeference

    def make_soil(self, params: SoilParams) -> Soil:
        """Return the undisturbed soil of the site.

        Raises:
            SoilError: a soil id has no kind of soil, or a layer has another shape than the terrain.
            ParameterError: both the site and `params` give a moisture; or as of
                `SoilParams.soil_types`.
        """
        ids, moisture = self.layers.soil, self.layers.moisture
        if ids is not None and ids.max() > len(params.additional_soils):
            raise SoilError(
                f"the ids in site.soil_map or site.terrain go to {ids.max()}, but"
                f" soil.additional_soils names {len(params.additional_soils)} kinds (ids 1 and up);"
                " name one for each id, or correct the ids"
            )
        if moisture is not None and params.moisture >= 0:
            raise ParameterError(
                f"soil.moisture is {params.moisture} and site.moisture_map or site.terrain also"
                " give a moisture; leave one of them out"
            )
        return Soil(self.grid, self.heights, params, soil=ids, moisture=moisture)

    def cut_fill(self, elevation: NDArray[np.float64]) -> CutFill | None:
        """Return cut and fill of a surface [m], shape (rows, cols); None without a design."""
        if self.design is None:
            return None
        return compare_to_design(self.design, elevation, tolerance=self.tolerance)


_CORRELATION_LENGTH = 4.0
"""Correlation length of rough terrain [m]: hummocks about as large as a machine."""

_SUFFIXES_WITHOUT_SPACING = (".npy", ".png")
"""Suffixes of files without a spacing; for others a missing spacing is an error."""


def make_site(params: SiteParams) -> Site:
    """Return the site that the parameters describe.

    Raises:
        TerrainError: a file is missing or invalid; the message begins with the parameter.
        ParameterError: a parameter applies to a file that is not given.
    """
    files = [path for name, path in params.files.items() if name in ("terrain", "design")]
    if params.vertical_scale != 1.0 and not files:
        raise ParameterError(
            f"site.vertical_scale is {params.vertical_scale} and no file has heights to scale;"
            " leave it out, or give a file in site.terrain or site.design"
        )
    if params.png_min_height != params.png_max_height and not any(map(_is_png, files)):
        raise ParameterError(
            "site.png_min_height and site.png_max_height apply to a .png and no file is one; leave"
            " them out"
        )
    if params.is_synthetic:
        ground, layers = _synthetic_terrain(params), Layers()
    else:
        with _prefix_errors("site.terrain"):
            ground, layers = _load_terrain_file(params)
    soil, moisture, design = layers.soil, layers.moisture, None
    if params.soil_map:
        with _prefix_errors("site.soil_map"):
            soil = load_layer(
                params.soil_map, ground.grid, kind="soil", georeference=ground.georeference
            )
    if params.moisture_map:
        with _prefix_errors("site.moisture_map"):
            moisture = load_layer(
                params.moisture_map, ground.grid, kind="moisture", georeference=ground.georeference
            )
    if params.design:
        with _prefix_errors("site.design"):
            design = _load_design_surface(params, ground)
    return Site(ground, Layers(soil, moisture), design, params.design_tolerance)


def _synthetic_terrain(params: SiteParams) -> HeightMap:
    grid = Grid(params.num_points, params.num_points, params.cell)
    if params.terrain == "flat" or params.roughness == 0.0:
        return flat(grid)
    length = min(max(_CORRELATION_LENGTH, grid.cell), min(grid.size))
    rng = np.random.default_rng(params.seed)
    return rough(grid, rms=params.roughness, correlation_length=length, rng=rng)


def _load_terrain_file(params: SiteParams) -> tuple[HeightMap, Layers]:
    path = params.terrain
    if Path(path).suffix.lower() == ".npz":
        return load_terrain_with_layers(path, vertical_scale=params.vertical_scale)

    def load(cell: float | None) -> HeightMap:
        return load_terrain(
            path,
            cell=cell,
            vertical_scale=params.vertical_scale,
            height_range=_height_range(params, path),
        )

    return _load_with_fallback_spacing(load, path, params.cell), Layers()


def _load_design_surface(params: SiteParams, ground: HeightMap) -> DesignSurface:
    def load(cell: float | None) -> DesignSurface:
        return load_design(
            params.design,
            ground.grid,
            georeference=ground.georeference,
            cell=cell,
            vertical_scale=params.vertical_scale,
            height_range=_height_range(params, params.design),
        )

    return _load_with_fallback_spacing(load, params.design, ground.grid.cell)


def _load_with_fallback_spacing(load: Callable[[float | None], T], path: str, cell: float) -> T:
    """Load a file with the spacing that it states, otherwise with the spacing `cell` [m]."""
    try:
        return load(None)
    except TerrainError:
        if Path(path).suffix.lower() not in _SUFFIXES_WITHOUT_SPACING:
            raise
        return load(cell)  # raises again if the error was another one


def _height_range(params: SiteParams, path: str) -> tuple[float, float] | None:
    is_given = params.png_min_height != params.png_max_height and _is_png(path)
    return (params.png_min_height, params.png_max_height) if is_given else None


def _is_png(path: str) -> bool:
    return Path(path).suffix.lower() == ".png"


@contextmanager
def _prefix_errors(name: str) -> Iterator[None]:
    """Prefix errors of the block with the parameter that they are about."""
    try:
        yield
    except TerrainError as error:
        raise TerrainError(f"{name}: {error}", error.code) from error
