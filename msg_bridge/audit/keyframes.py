"""Terrain maps of a run, stored as differences: a long bag has hundreds."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from msg_bridge.codec.terrain import TerrainMap
from msg_bridge.contract.grid import Grid

__all__ = ["Keyframes"]

Volumes = NDArray[np.int64]
"""Bank volume of every column [mm^3], flat, row-major."""


class Keyframes:
    """Volumes of all columns at some revisions of the terrain.

    Attributes:
        grid: that of the first map, None before; maps of another grid are not stored.
        conflicting: revisions with two different maps.
        out_of_order: revisions after newer ones, or of another grid; not stored.
    """

    def __init__(self) -> None:
        self.grid: Grid | None = None
        self.conflicting: list[int] = []
        self.out_of_order: list[int] = []
        self._revisions: list[int] = []
        self._first: Volumes = np.zeros(0, dtype=np.int64)
        self._last: Volumes = self._first
        self._changes: list[tuple[NDArray[np.int64], Volumes]] = []  # (cells, new volumes)

    @property
    def revisions(self) -> list[int]:
        """The stored revisions, ascending."""
        return self._revisions

    def add(self, terrain: TerrainMap) -> None:
        """Store a map, or note why it is not stored."""
        revision, volumes = terrain.keyframe.revision, terrain.volume_mm3.reshape(-1)
        if self.grid is None:
            self.grid = terrain.keyframe.grid
            self._append(revision, volumes)
        elif terrain.keyframe.grid != self.grid or revision < self._revisions[-1]:
            self.out_of_order.append(revision)
        elif revision == self._revisions[-1]:
            if (volumes != self._last).any():
                self.conflicting.append(revision)
        else:
            self._append(revision, volumes)

    def between(self, first: int, last: int) -> Keyframes:
        """Return the maps with revisions from `first` to `last`."""
        part = Keyframes()
        for revision, volumes in self:
            if first <= revision <= last:
                part.grid = self.grid
                part._append(revision, volumes.copy())
        return part

    def _append(self, revision: int, volumes: Volumes) -> None:
        if self._revisions:
            changed = np.flatnonzero(volumes != self._last)
            self._changes.append((changed, volumes[changed]))
        else:
            self._first = volumes
        self._revisions.append(revision)
        self._last = volumes

    def __iter__(self) -> Iterator[tuple[int, Volumes]]:
        """Iterate over (revision, volumes) in order; the next step changes the array in place."""
        if not self._revisions:
            return
        volumes = self._first.copy()
        yield self._revisions[0], volumes
        for revision, (cells, values) in zip(self._revisions[1:], self._changes, strict=True):
            volumes[cells] = values
            yield revision, volumes
