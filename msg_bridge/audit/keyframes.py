"""Terrain maps of a run, kept as what changed between them: a long bag has hundreds."""

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
    """Volumes of all columns at some revisions.

    Attributes:
        grid: of the first; maps of another grid are not kept.
        conflicting: revisions of which there were two different maps.
        out_of_order: revisions that came after newer ones, or on another grid; not kept.
    """

    def __init__(self) -> None:
        self.grid: Grid | None = None
        self.conflicting: list[int] = []
        self.out_of_order: list[int] = []
        self._revisions: list[int] = []
        self._first: Volumes = np.zeros(0, dtype=np.int64)
        self._last: Volumes = self._first
        self._changes: list[tuple[NDArray[np.int64], Volumes]] = []

    @property
    def revisions(self) -> list[int]:
        """Of those kept, rising."""
        return self._revisions

    def add(self, terrain: TerrainMap) -> None:
        """Keep a map."""
        revision, volume = terrain.keyframe.revision, terrain.volume_mm3.reshape(-1)
        if self.grid is None:
            self.grid = terrain.keyframe.grid
            self._first = self._last = volume
            self._revisions.append(revision)
        elif terrain.keyframe.grid != self.grid or revision < self._revisions[-1]:
            self.out_of_order.append(revision)
        elif revision == self._revisions[-1]:
            if (volume != self._last).any():
                self.conflicting.append(revision)
        else:
            changed = np.flatnonzero(volume != self._last)
            self._changes.append((changed, volume[changed]))
            self._revisions.append(revision)
            self._last = volume

    def __iter__(self) -> Iterator[tuple[int, Volumes]]:
        """(revision, volumes) in order; the array is changed by the next step."""
        if not self._revisions:
            return
        volumes = self._first.copy()
        yield self._revisions[0], volumes
        for revision, (cells, values) in zip(self._revisions[1:], self._changes, strict=True):
            volumes[cells] = values
            yield revision, volumes
