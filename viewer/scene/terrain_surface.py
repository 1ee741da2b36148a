"""The terrain surface of a run, from maps and map updates in any order of arrival.

Rows that an observer has lost are not sent again. A map update has the complete state of
its cell, so later rows are applied in any case; the cells of the lost rows are repaired by the next
map that is at least as new.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.map_updates import map_updates_after
from msg_bridge.contract.messages import RowChunk
from msg_bridge.contract.rows import MAP_UPDATE, Rows, join_rows
from viewer.scene.terrain_tiles import SurfaceLayers, TerrainTiles

__all__ = ["SurfaceMap", "TerrainSurface"]

_MAX_RETAINED_ROWS = 1_000_000
"""Maximum number of rows kept for a map that is older than they are."""


class SurfaceMap:
    """A map: the surface after one revision, and what it is compared with.

    Attributes:
        run_id: number of the run.
        revision: revision of the terrain.
        grid: the grid.
        layers: the surface.
        design: elevation to be made [m], shape (rows, cols), float32, NaN outside of the design;
            None without one.
    """

    def __init__(
        self,
        run_id: int,
        revision: int,
        grid: Grid,
        layers: SurfaceLayers,
        design: NDArray[np.float32] | None = None,
    ) -> None:
        self.run_id, self.revision, self.grid = run_id, revision, grid
        self.layers, self.design = layers, design


class TerrainSurface:
    """The surface of the present run.

    Attributes:
        run_id: number of the run; None before the first map or configuration.
        revision: revision of the terrain.
        tiles: the surface; None before the first map of the run.
        reference: elevation of the first map of the run [m], shape (rows, cols), float32.
        design: elevation to be made, as of `SurfaceMap`.
        version: increases with each new `tiles` or `design`, and at the start of a run.
        gaps: number of gaps in the rows so far.
    """

    def __init__(self) -> None:
        self.version = 0
        self.gaps = 0
        self._is_configured = False  # whether a configuration names the run
        self._early_map: SurfaceMap | None = None  # of a run that is not configured yet
        self._early_chunks: list[RowChunk] = []
        self._reset(None)

    def _reset(self, run_id: int | None) -> None:
        self.run_id = run_id
        self.revision = -1
        self.tiles: TerrainTiles | None = None
        self.reference: NDArray[np.float32] | None = None
        self.design: NDArray[np.float32] | None = None
        self.version += 1
        self._map_revision = -1  # of the map that was adopted last
        self._last_seq: int | None = None  # number of the last row received
        self._gap_revision: int | None = None  # maps from this revision on have all lost rows
        self._retained: list[Rows] = []  # rows that a map may lack, in order
        self._num_retained = 0
        self._retained_after = -1  # revision after which no row was dropped

    @property
    def has_gap(self) -> bool:
        """Whether rows were lost that no map has repaired yet."""
        return self._gap_revision is not None

    def start_run(self, run_id: int) -> None:
        """Follow a run, as its configuration names it."""
        self._is_configured = True
        if run_id == self.run_id:
            return
        self._reset(run_id)
        early_map, chunks = self._early_map, self._early_chunks
        self._early_map, self._early_chunks = None, []
        if early_map is not None and early_map.run_id == run_id:
            self.receive_map(early_map)
        for chunk in chunks:
            if chunk.run_id == run_id:
                self.receive_updates(chunk)

    def is_needed(self, run_id: int, revision: int) -> bool:
        """Return whether a map would change the surface, so that it should be decoded."""
        if run_id != self.run_id or self.tiles is None:
            return True
        if self._gap_revision is not None:
            return revision >= self._gap_revision
        return revision > self.revision

    def skip_map(self, revision: int) -> None:
        """Drop rows that are contained in a map that was not needed: no older map follows."""
        while self._retained and int(self._retained[0]["revision"][-1]) <= revision:
            self._drop_first_retained()

    def receive_map(self, surface: SurfaceMap) -> None:
        """Process a map; one that brings nothing new is ignored."""
        if surface.run_id != self.run_id:
            if self._is_configured:
                self._early_map = surface
                return
            self._reset(surface.run_id)
        if not self.is_needed(surface.run_id, surface.revision):
            self.skip_map(surface.revision)
        elif self.tiles is None or surface.revision >= self._retained_after:
            self._adopt(surface)

    def receive_updates(self, chunk: RowChunk) -> None:
        """Process MAP_UPDATE rows; rows that were received before are ignored.

        Raises:
            ExchangeError: OFF_MAP: a row lies outside of the map.
        """
        if chunk.run_id != self.run_id:
            self._store_early(chunk)
            return
        rows = self._rows_not_seen(chunk.rows)
        if rows.size == 0:
            return
        self._last_seq = int(rows["seq"][-1])
        self._retain(rows)
        self._apply(rows)

    def restore(self, surface: SurfaceMap, reference: SurfaceMap) -> None:
        """Return to an earlier or later map of the configured run.

        Args:
            surface: the map; rows that follow it are received next.
            reference: the first map of the run.
        """
        if self.tiles is None or self.tiles.grid != surface.grid or self.reference is None:
            self._reset(surface.run_id)
            self._adopt(reference)
        assert self.tiles is not None
        self.tiles.replace(surface.layers)
        self.revision = self._map_revision = self._retained_after = surface.revision
        self._last_seq = self._gap_revision = None
        self._retained, self._num_retained = [], 0

    def clear(self) -> None:
        """Return to the state before the first map of the run."""
        self._reset(self.run_id)

    def clear_run(self) -> None:
        """Return to the state before any configuration or map."""
        self._is_configured = False
        self._early_map, self._early_chunks = None, []
        self._reset(None)

    def _rows_not_seen(self, rows: Rows) -> Rows:
        """Return the rows that were not received before, and note a gap before them.

        The soil sends rows again that a machine has lost. Before the first row there may be a gap:
        the subscription may have begun between two messages of a tick.
        """
        if self._last_seq is not None:
            steps = rows["seq"] - np.uint32(self._last_seq)  # modulo 2**32
            rows = rows[(steps > 0) & (steps < 2**31)]
        if rows.size:
            number = int(rows["seq"][0])
            is_first_of_run = self._last_seq is None and number == 1
            if number != ((self._last_seq or 0) + 1) % 2**32 and not is_first_of_run:
                self.gaps += self._last_seq is not None
                self._gap_revision = int(rows["revision"][0])
        return rows

    def _apply(self, rows: Rows) -> None:
        later = map_updates_after(self._map_revision, rows)
        if self.tiles is None or later.size == 0:
            return
        self.tiles.update(later)
        self.revision = int(later["revision"][-1])

    def _adopt(self, surface: SurfaceMap) -> None:
        if self.tiles is None or self.tiles.grid != surface.grid:
            self.tiles = TerrainTiles(surface.layers, surface.grid)
            self.reference = np.asarray(surface.layers.height, dtype=np.float32)
            self.version += 1
        else:
            self.tiles.replace(surface.layers)
        if surface.design is not None and self.design is None:
            self.design = surface.design
            self.version += 1
        if surface.revision < self._retained_after:
            self._gap_revision = self._retained_after
        elif self._gap_revision is not None and self._gap_revision <= surface.revision:
            self._gap_revision = None
        self.revision = self._map_revision = surface.revision
        self.skip_map(surface.revision)
        self._apply(join_rows(self._retained, MAP_UPDATE))

    def _retain(self, rows: Rows) -> None:
        self._retained.append(rows)
        self._num_retained += rows.size
        while self._num_retained > _MAX_RETAINED_ROWS:
            self._retained_after = int(self._retained[0]["revision"][-1])
            self._drop_first_retained()

    def _drop_first_retained(self) -> None:
        self._num_retained -= self._retained.pop(0).size

    def _store_early(self, chunk: RowChunk) -> None:
        if self._early_chunks and self._early_chunks[0].run_id != chunk.run_id:
            self._early_chunks = []
        if sum(each.rows.size for each in self._early_chunks) < _MAX_RETAINED_ROWS:
            self._early_chunks.append(chunk)
