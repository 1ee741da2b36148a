"""Contact surface: the machines' copy of the terrain, which tracks and particles touch.

The soil simulation owns the heights; this copy applies its changed cells. Soil that is deposited
under a resting particle raises the surface below it, and a step inside a stiff contact would eject
the particle. The *contact* surface therefore rises toward the soil's surface at no more than
`MAX_RISE_SPEED`, which lifts the particle; it falls with the soil's surface at once.

The pressure under a track depends on its sinkage below the *undisturbed* surface, which is higher
by the depth of the rut that the soil reports. That surface rises and falls in the same way.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from machine_sim.ground.contact_surface_kernels import (
    MAX_MOISTURE,
    GroundLayers,
    apply_map_updates,
    raise_surface,
    set_cells,
    surface_at,
)
from msg_bridge.contract.errors import EarthmovingError, ErrorCode, ExchangeError
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.rows import Rows
from msg_bridge.kernels import box_table

__all__ = ["MAX_RISE_SPEED", "Ground", "GroundError", "surface_at"]

MAX_RISE_SPEED = 0.3
"""Maximum speed of rise of the contact surface [m/s]."""


class GroundError(EarthmovingError):
    """Raised for an invalid terrain or change of it."""


class Ground:
    """Heights and materials of the terrain in the grid's matrix order.

    Attributes:
        grid: position of each height.
        half_size: half the extent of the map along x and y [m].
        elevation: the soil's surface [m], shape (rows, cols), float64.
        surface: contact surface [m], same shape; equal to `elevation` except where it still rises.
        rut_depth: depth by which soil was pressed down [m], same shape, float64.
        max_sinkage: maximum depth of soles below the undisturbed surface [m], same shape, at least
            `rut_depth`; soles write it.
        undisturbed_surface: contact surface before it was pressed down [m], same shape.
        soils: all soils of the terrain, by id.
        frame: position of the grid in the map frame, as kernels need it to find the cell of a
            point: x of row 0 and y of column 0 [m], and 1 / cell size [1/m].
        soil, moisture: soil id and moisture [% of saturation] at the surface, same shape, uint8.
        changed, has_changes: which cells have changed, same shape, and whether any has; their only
            reader, the engine of the particles, clears them.
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
            soil, moisture: see the attributes; zeros if None.
        """
        self.grid = grid
        # A plain tuple: Numba resolves the type of a named one in Python at every call.
        self.frame: tuple[float, float, float] = (grid.x_first, grid.y_first, 1.0 / grid.cell)
        size_x, size_y = grid.size
        self.half_size = 0.5 * size_x, 0.5 * size_y
        self.soils = tuple(soils)
        zeros = np.zeros(grid.shape, dtype=np.uint8)
        self.soil: NDArray[np.uint8] = self._check_soil_ids(zeros if soil is None else soil).copy()
        self.moisture: NDArray[np.uint8] = np.minimum(
            zeros if moisture is None else moisture, MAX_MOISTURE
        )
        self.elevation = self._rounded_heights(elevation)
        self.surface: NDArray[np.float64] = self.elevation.copy()
        self.undisturbed_surface: NDArray[np.float64] = self.elevation.copy()
        self.rut_depth: NDArray[np.float64] = np.zeros(grid.shape)
        self.max_sinkage: NDArray[np.float64] = np.zeros(grid.shape)
        self._rising_cells: NDArray[np.int64] = np.zeros(0, dtype=np.int64)  # flat, unique
        self.changed: NDArray[np.bool_] = np.zeros(grid.shape, dtype=np.bool_)
        self.has_changes = False
        self._layers = GroundLayers(
            self.elevation,
            self.surface,
            self.undisturbed_surface,
            self.rut_depth,
            self.max_sinkage,
            self.soil,
            self.moisture,
            self.changed,
            is_rising=np.zeros(grid.shape, dtype=np.bool_),
        )
        self._boxed_layers = box_table(self._layers)

    def continue_from(self, other: Ground) -> None:
        """Take terrain and ruts from a ground of the same grid; soils keep their ids.

        Raises:
            GroundError: it has a soil that this one lacks.
        """
        self._check_soil_ids(other.soil)
        layers: Iterable[tuple[NDArray[Any], NDArray[Any]]]
        layers = zip(self._layers, other._layers, strict=True)
        for layer, before in layers:
            layer[:] = before
        self._rising_cells = other._rising_cells.copy()
        self.changed[:] = self.has_changes = True

    def check_keyframe(self, keyframe: Keyframe) -> None:
        """Check that a terrain can be applied: its grid, heights and soils.

        Raises:
            ExchangeError: GRID: another grid; VALUE.
        """
        if keyframe.grid != self.grid:
            raise ExchangeError(
                f"a terrain map has the grid {keyframe.grid}; the run has {self.grid}",
                ErrorCode.GRID,
            )
        layers = (keyframe.elevation, keyframe.rut_depth, keyframe.soil, keyframe.moisture)
        if any(layer.shape != self.grid.shape for layer in layers):
            raise ExchangeError(
                f"the layers of a terrain map have the shapes {[each.shape for each in layers]};"
                f" the grid has {self.grid.shape}",
                ErrorCode.GRID,
            )
        is_finite = np.isfinite(keyframe.elevation).all() and np.isfinite(keyframe.rut_depth).all()
        if not is_finite or keyframe.rut_depth.min() < 0.0:
            raise ExchangeError(
                "a terrain map has heights or depths of ruts that are not finite, or below 0",
                ErrorCode.VALUE,
            )
        if keyframe.soil.max() >= len(self.soils):
            raise ExchangeError("a terrain map has soils unknown in the run", ErrorCode.VALUE)

    def apply_keyframe(self, keyframe: Keyframe) -> None:
        """Replace the whole terrain; the contact surface rises to it at its limited speed."""
        self.soil[:], self.moisture[:] = (
            self._check_soil_ids(keyframe.soil),
            np.minimum(keyframe.moisture, MAX_MOISTURE),
        )
        elevation = self._rounded_heights(keyframe.elevation)
        self._set_cells(
            np.arange(elevation.size),
            elevation.reshape(-1),
            keyframe.rut_depth.reshape(-1).astype(np.float64),
        )

    def apply_changes(self, map_updates: Rows) -> None:
        """Apply changed heights, soils and moistures.

        Args:
            map_updates: MAP_UPDATE rows.

        Raises:
            GroundError: an unknown soil, a cell off the map, or a height that is not finite;
                nothing was changed.
        """
        if map_updates.size == 0:
            return
        rising = self._rising_cells_and_space_for(map_updates.size)
        num_rising = apply_map_updates(
            map_updates,
            len(self.soils),
            self._boxed_layers,
            rising,
            self._rising_cells.size,
        )
        if num_rising < 0:
            self._check_soil_ids(map_updates["soil"])
            raise GroundError(
                "a changed cell is off the map or has no finite height; resync from the terrain map"
            )
        self._rising_cells = rising[:num_rising]
        self.has_changes = True

    def set_heights(
        self,
        rows: NDArray[np.integer],
        cols: NDArray[np.integer],
        heights: NDArray[np.floating],
    ) -> None:
        """Set `elevation[rows, cols] = heights` [m]; the depths of ruts remain."""
        if rows.size == 0:
            return
        cells = np.ravel_multi_index((rows, cols), self.grid.shape)
        self._set_cells(
            cells,
            np.ascontiguousarray(heights, dtype=np.float64),
            self.rut_depth.reshape(-1)[cells],
        )

    def _set_cells(
        self,
        cells: NDArray[np.int64],
        heights: NDArray[np.float64],
        rut_depths: NDArray[np.float64],
    ) -> None:
        """Set heights and depths of ruts of cells [m]."""
        if not np.isfinite(heights).all():
            raise GroundError("a changed cell has no finite height; resync from the terrain map")
        rising = self._rising_cells_and_space_for(cells.size)
        num_rising = set_cells(
            cells,
            heights,
            rut_depths,
            self._boxed_layers,
            rising,
            self._rising_cells.size,
        )
        self._rising_cells = rising[:num_rising]
        self.has_changes = True

    def _rising_cells_and_space_for(self, count: int) -> NDArray[np.int64]:
        """Return a copy of the list of rising cells, with space for `count` more at its end."""
        rising = np.empty(self._rising_cells.size + count, dtype=np.int64)
        rising[: self._rising_cells.size] = self._rising_cells
        return rising

    def advance(self, dt: float) -> None:
        """Raise the contact surface toward the soil's surface for `dt` [s]."""
        if self._rising_cells.size == 0:
            return
        num_rising = raise_surface(self._rising_cells, MAX_RISE_SPEED * dt, self._boxed_layers)
        self._rising_cells = self._rising_cells[:num_rising]
        self.has_changes = True

    def _check_soil_ids(self, soil: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return soil ids after checking that each is known."""
        if soil.max() >= len(self.soils):
            raise GroundError(
                f"the terrain has soil id {soil.max()} and the machine {len(self.soils)} soils;"
                " start the machine with the soils of this run"
            )
        return soil

    def _rounded_heights(self, elevation: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return a float64 copy of terrain heights [m], rounded to float32.

        Messages carry float32: a machine in the soil's process must have the same heights as one
        in another process.
        """
        if elevation.shape != self.grid.shape or not np.isfinite(elevation).all():
            raise GroundError(
                f"terrain heights must be finite and of shape {self.grid.shape}, got"
                f" {elevation.shape}"
            )
        return np.asarray(elevation, dtype=np.float32).astype(np.float64)

    def height(self, x: float, y: float) -> float:
        """Return the height of the contact surface [m] at (x, y) [m], map frame."""
        return float(surface_at(self.surface, *self.frame, x, y)[0])
