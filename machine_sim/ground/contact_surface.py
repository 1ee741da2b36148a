"""The terrain as machines feel it: a copy of the soil's surface that tracks and particles touch.

The soil owns the heights; this copy follows its changed cells. Soil that is put down under a
resting particle raises the surface under it, and a step up inside a stiff contact would fire the
particle into the air. The *contact* surface therefore rises at a bounded speed toward the true
one (and falls with it at once): the particle is lifted, not shot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from machine_sim.ground.track_compaction import TrackCompaction
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.rows import Rows
from msg_bridge.kernels import kernel

__all__ = ["MAX_RISE_SPEED", "Ground", "GroundError", "surface_at"]

MAX_RISE_SPEED = 0.3
"""Fastest rise of the contact surface [m/s]."""


_MAX_MOISTURE = 100
"""Highest moisture there are figures for [%]."""


class GroundError(EarthmovingError):
    """A terrain or a change of it that machines cannot stand on."""


class Ground:
    """Heights of the terrain in the grid's matrix order.

    Attributes:
        grid: where each height lies.
        elevation: the soil's surface [m], shape (rows, cols), float64.
        surface: the contact surface [m], same shape; `elevation` except where it still rises.
        soils: all soils of the terrain, by id.
        soil, moisture: id and moisture [% of saturation] of what the surface is of, uint8.
        volume_mm3: bank volume of each column, same shape, float64; NaN where it is not known.
        level: the contact surface as if no track had pressed it [m], same shape.
        sunk: how far soles have been below that [m], same shape; soles write it.
    """

    def __init__(
        self,
        grid: Grid,
        elevation: NDArray[np.floating],
        *,
        soils: Sequence[LooseSoil] = (LooseSoil(),),
        soil: NDArray[np.uint8] | None = None,
        moisture: NDArray[np.uint8] | None = None,
    ) -> None:
        """
        Args:
            grid, elevation, soils: see the attributes.
            soil, moisture: see the attributes; zeros if not given.
        """
        self.grid = grid
        self.soils = tuple(soils)
        zeros = np.zeros(grid.shape, dtype=np.uint8)
        self.soil: NDArray[np.uint8] = self._check_soil_ids(zeros if soil is None else soil).copy()
        self.moisture: NDArray[np.uint8] = np.minimum(
            zeros if moisture is None else moisture, _MAX_MOISTURE
        )
        self.elevation = self._rounded_heights(elevation)
        self.surface: NDArray[np.float64] = self.elevation.copy()
        self.undisturbed_surface: NDArray[np.float64] = self.elevation.copy()
        self._compaction = TrackCompaction(grid, max(soil.swell for soil in self.soils))
        self._rising_cells: NDArray[np.int64] = np.zeros(
            0, dtype=np.int64
        )  # flat indices, each once
        self._is_rising: NDArray[np.bool_] = np.zeros(grid.shape, dtype=np.bool_)  # which they are
        self._changed: NDArray[np.bool_] = np.zeros(grid.shape, dtype=np.bool_)
        self._is_changed = False

    @property
    def volume_mm3(self) -> NDArray[np.float64]:
        """See the attributes."""
        return self._compaction.volume_mm3

    @property
    def max_sinkage(self) -> NDArray[np.float64]:
        """See the attributes."""
        return self._compaction.max_sinkage

    @property
    def frame(self) -> tuple[float, float, float]:
        """(x of row 0, y of column 0, 1/cell): what the kernels need to find a column."""
        return (self.grid.x_first, self.grid.y_first, 1.0 / self.grid.cell)

    def apply_keyframe(self, keyframe: Keyframe) -> None:
        """Take over the whole terrain; rises show bit by bit as ever."""
        self.soil[:], self.moisture[:] = (
            self._check_soil_ids(keyframe.soil),
            np.minimum(keyframe.moisture, _MAX_MOISTURE),
        )
        elevation = self._rounded_heights(keyframe.elevation)
        rise, volume = (elevation - self.elevation).reshape(-1), keyframe.volume_mm3.reshape(-1)
        self._compaction.apply_changes(np.arange(rise.size), rise, volume.astype(np.float64))
        self.elevation[:] = elevation
        np.minimum(self.surface, self.elevation, out=self.surface)
        self.undisturbed_surface[:] = self.surface + self._compaction.compaction_depth
        self._changed[:] = self._is_changed = True
        self._is_rising[:] = self.surface < self.elevation
        self._rising_cells = np.flatnonzero(self._is_rising)

    def apply_changes(self, changed: Rows) -> None:
        """Take over changed cells and what they are of now.

        Args:
            changed: CHANGED rows.
        """
        if changed.size == 0:
            return
        soil = self._check_soil_ids(changed["soil"])
        cells = np.ravel_multi_index((changed["row"], changed["col"]), self.grid.shape)
        heights, volume = (changed[name].astype(np.float64) for name in ("z", "volume_mm3"))
        self._set_cells(cells, heights, volume)
        self.soil.reshape(-1)[cells] = soil
        self.moisture.reshape(-1)[cells] = np.minimum(changed["moisture"], _MAX_MOISTURE)

    def set_heights(
        self,
        rows: NDArray[np.integer],
        cols: NDArray[np.integer],
        heights: NDArray[np.floating],
        volume_mm3: NDArray[np.float64] | None = None,
    ) -> None:
        """Take over changed cells: `elevation[rows, cols] = heights` [m], and volumes if known."""
        if rows.size == 0:
            return
        volume = np.full(rows.size, np.nan)
        if volume_mm3 is not None:
            volume[:] = volume_mm3
        cells = np.ravel_multi_index((rows, cols), self.grid.shape)
        self._set_cells(cells, np.ascontiguousarray(heights, dtype=np.float64), volume)

    def _set_cells(
        self,
        cells: NDArray[np.int64],
        heights: NDArray[np.float64],
        volume_mm3: NDArray[np.float64],
    ) -> None:
        """Take over changed cells by their flat indices; volumes are NaN where not known."""
        if not np.isfinite(heights).all():
            raise GroundError("a changed cell has no finite height; resync from the terrain map")
        self._compaction.apply_changes(
            cells, heights - self.elevation.reshape(-1)[cells], volume_mm3
        )
        self._rising_cells = _set_cells_kernel(
            cells, heights, self.elevation, self.surface, self._compaction.compaction_depth, self.undisturbed_surface,
            self._changed, self._is_rising, self._rising_cells,
        )  # fmt: skip
        self._is_changed = True

    def pop_changed_cells(self) -> NDArray[np.bool_] | None:
        """Where the terrain changed or rose since this was asked last, shape (rows, cols).

        None if nowhere. It is for one reader.
        """
        if not self._is_changed:
            return None
        changed = self._changed.copy()
        self._changed[:] = self._is_changed = False
        return changed

    def advance(self, dt: float) -> None:
        """Let the contact surface rise toward the soil's for `dt` [s]."""
        if self._rising_cells.size == 0:
            return
        self._rising_cells = _raise_surface(
            self._rising_cells, MAX_RISE_SPEED * dt, self.elevation, self.surface, self._compaction.compaction_depth,
            self.undisturbed_surface, self._changed, self._is_rising,
        )  # fmt: skip
        self._is_changed = True

    def _check_soil_ids(self, soil: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The ids of soils, each of which there is."""
        if soil.max() >= len(self.soils):
            raise GroundError(
                f"the ground is of soil {soil.max()} and the machine knows {len(self.soils)}; start"
                " it with the soils of this run"
            )
        return soil

    def _rounded_heights(self, elevation: NDArray[np.floating]) -> NDArray[np.float64]:
        """A copy of terrain heights as all machines feel them, near the soil or far from it.

        Messages carry float32: in the soil's own process a machine must not stand on other bits.
        """
        if elevation.shape != self.grid.shape or not np.isfinite(elevation).all():
            raise GroundError(
                f"terrain heights must be finite and of shape {self.grid.shape}, got"
                f" {elevation.shape}"
            )
        return np.asarray(elevation, dtype=np.float32).astype(np.float64)

    def height(self, x: float, y: float) -> float:
        """Contact surface [m] at a point of the map frame; the outer column goes on beyond."""
        return float(surface_at(self.surface, *self.frame, x, y)[0])


@kernel(inline="always")
def surface_at(surface, x_first, y_first, inverse_cell, x, y):  # type: ignore[no-untyped-def]
    """Bilinear height [m] and its slopes dz/dx, dz/dy at (x, y) [m], map frame.

    Beyond the outer grid points the edge goes on level.
    """
    rows, cols = surface.shape
    u = min(max((x_first - x) * inverse_cell, 0.0), rows - 1.0)
    v = min(max((y_first - y) * inverse_cell, 0.0), cols - 1.0)
    i = min(int(math.floor(u)), rows - 2)
    j = min(int(math.floor(v)), cols - 2)
    u -= i
    v -= j
    a, b = surface[i, j], surface[i, j + 1]
    c, d = surface[i + 1, j], surface[i + 1, j + 1]
    height = (a * (1 - v) + b * v) * (1 - u) + (c * (1 - v) + d * v) * u
    slope_x = -((c - a) * (1 - v) + (d - b) * v) * inverse_cell
    slope_y = -((b - a) * (1 - u) + (d - c) * u) * inverse_cell
    return height, slope_x, slope_y


@kernel
def _set_cells_kernel(  # type: ignore[no-untyped-def]
    cells,
    heights,
    elevation,
    surface,
    compaction_depth,
    undisturbed_surface,
    changed,
    is_rising,
    rising,
):
    """See `Ground._take`; returns the cells that rise now, one that is lowered again among them."""
    cols = elevation.shape[1]
    waiting = np.empty(rising.size + cells.size, dtype=np.int64)
    for n in range(rising.size):  # not a slice, which compiles much longer
        waiting[n] = rising[n]
    count = rising.size
    for n in range(cells.size):
        i, j = cells[n] // cols, cells[n] % cols
        elevation[i, j] = heights[n]
        changed[i, j] = True
        if heights[n] < surface[i, j]:
            surface[i, j] = heights[n]
        elif not is_rising[i, j]:
            is_rising[i, j] = True
            waiting[count] = cells[n]
            count += 1
        undisturbed_surface[i, j] = surface[i, j] + compaction_depth[i, j]
    return waiting[:count].copy()


@kernel
def _raise_surface(  # type: ignore[no-untyped-def]
    rising, step, elevation, surface, compaction_depth, undisturbed_surface, changed, is_rising
):
    """Let cells rise by `step` [m] at most; returns those that are not up yet."""
    cols = elevation.shape[1]
    left = np.empty(rising.size, dtype=np.int64)
    count = 0
    for n in range(rising.size):
        i, j = rising[n] // cols, rising[n] % cols
        surface[i, j] = min(surface[i, j] + step, elevation[i, j])
        undisturbed_surface[i, j] = surface[i, j] + compaction_depth[i, j]
        changed[i, j] = True
        is_rising[i, j] = surface[i, j] < elevation[i, j]
        if is_rising[i, j]:
            left[count] = rising[n]
            count += 1
    return left[:count].copy()
