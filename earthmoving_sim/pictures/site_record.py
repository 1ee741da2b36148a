"""SiteRecord: the ground before and after a run, the lip's path and the machine, for pictures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from earthmoving_sim.coloured_mesh import ColouredMesh
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.grid import Grid

__all__ = ["MIN_CHANGE_M", "SiteRecord"]

MIN_CHANGE_M = 0.01  # minimum change of height of a column that counts as changed [m]


@dataclass(frozen=True, eq=False)
class SiteRecord:
    """A site before and after a run, with the lip's path and the machine, in the map frame.

    Attributes:
        grid: grid of the terrain.
        before: height of each column before the run [m], shape (rows, cols).
        after: height of each column after the run [m], shape (rows, cols).
        loose_depth: depth of loose soil on each column after the run [m], shape (rows, cols).
        lip_path: middle of the bucket's lip over time [m], shape (n, 3).
        lip_cycle: cycle of each point, from 1, shape (n,).
        lip_phase: phase of each point, such as "dig", shape (n,).
        machine_outline: name and plan-view polygon [m], shape (k, 2), of each part of the machine
            at the end.
        title: heading of the pictures.
        machine_mesh: triangles of the machine at the end; without them the 3-D view has no machine.
        machine_position: x, y of the machine's swing axis [m]; None: the middle of the outlines.
        num_finished_cycles: number of cycles that were finished; later points of the path belong to
            one that was not. None: all cycles of the path were.

    Raises:
        ParameterError: an array has another shape, or a height is not finite.
    """

    grid: Grid
    before: NDArray[np.float64]
    after: NDArray[np.float64]
    loose_depth: NDArray[np.float64]
    lip_path: NDArray[np.float64]
    lip_cycle: NDArray[np.integer]
    lip_phase: NDArray[np.str_]
    machine_outline: Sequence[tuple[str, NDArray[np.float64]]]
    title: str
    machine_mesh: ColouredMesh | None = None
    machine_position: tuple[float, float] | None = None
    num_finished_cycles: int | None = None

    def __post_init__(self) -> None:
        for name in ("before", "after", "loose_depth"):
            heights = getattr(self, name)
            _expect_shape(name, heights, self.grid.shape)
            if not np.isfinite(heights).all():
                raise ParameterError(f"{name} has values that are not finite; fill the gaps first")
        points = len(self.lip_path)
        _expect_shape("lip_path", self.lip_path, (points, 3))
        _expect_shape("lip_cycle", self.lip_cycle, (points,))
        _expect_shape("lip_phase", self.lip_phase, (points,))
        for name, polygon in self.machine_outline:
            _expect_shape(f"machine_outline {name!r}", polygon, (len(polygon), 2))

    @property
    def change(self) -> NDArray[np.float64]:
        """Height after minus height before [m], shape (rows, cols); cut is negative."""
        return self.after - self.before

    @property
    def cut_volume(self) -> float:
        """Volume between the surfaces where the new one is lower [m^3]."""
        return float(-np.minimum(self.change, 0.0).sum() * self.grid.cell**2)

    @property
    def fill_volume(self) -> float:
        """Volume between the surfaces where the new one is higher [m^3]."""
        return float(np.maximum(self.change, 0.0).sum() * self.grid.cell**2)

    @property
    def num_cycles(self) -> int:
        """Number of finished cycles."""
        if self.num_finished_cycles is not None:
            return self.num_finished_cycles
        return len(np.unique(self.lip_cycle))

    def is_finished(self, cycle: int) -> bool:
        """Return whether a cycle of the path was finished."""
        return self.num_finished_cycles is None or cycle <= self.num_finished_cycles

    @property
    def machine_origin(self) -> NDArray[np.float64]:
        """x, y from which distances from the machine are measured [m], shape (2,).

        It is `machine_position`, else the middle of the outlines' bounding box, else the origin.
        """
        if self.machine_position is not None:
            return np.asarray(self.machine_position, dtype=np.float64)
        if not self.machine_outline:
            return np.zeros(2)
        corners = self.outline_points
        return np.asarray(0.5 * (corners.min(axis=0) + corners.max(axis=0)), dtype=np.float64)

    @property
    def outline_points(self) -> NDArray[np.float64]:
        """Corners of all outlines of the machine, x, y [m], shape (n, 2)."""
        return np.concatenate([np.empty((0, 2)), *(polygon for _, polygon in self.machine_outline)])

    @property
    def changed_points(self) -> NDArray[np.float64]:
        """Centres of columns whose height changed by more than 1 cm, x, y [m], shape (n, 2)."""
        rows, cols = np.nonzero(np.abs(self.change) > MIN_CHANGE_M)
        return np.stack([self.grid.x(rows), self.grid.y(cols)], axis=1)


def _expect_shape(name: str, array: NDArray[np.generic], shape: tuple[int, ...]) -> None:
    if np.shape(array) != shape:
        raise ParameterError(f"{name} has shape {np.shape(array)}; give an array of shape {shape}")
