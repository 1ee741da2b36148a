"""Decode terrain, as maps or tiles, with the exact cell size, whichever of them arrives first."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from sensor_msgs.msg import PointCloud2

from msg_bridge.codec import qos
from msg_bridge.codec.terrain import cells_of_terrain_cloud, keyframe_of_cells
from msg_bridge.codec.terrain_tiles import tile_from_cdr
from msg_bridge.codec.tile_assembly import TileAssembly
from msg_bridge.contract import topics
from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.rows import Rows
from msg_bridge.contract.topics import resolve
from msg_bridge.nodes.subscription_poller import SubscriptionPoller

__all__ = ["MapDecoder"]

_MAX_TILE_GAP = 2.0
"""Wall time after which a round of tiles is not completed any more [s]."""


class MapDecoder:
    """Decoder of the messages on `terrain/map` and `terrain/tiles`.

    The float32 positions of a map do not determine every cell size exactly; `sim/config` has it.
    That topic may arrive later, in the first run and after a soil node with another cell size has
    started, and a map is not published again before the terrain changes. So a map that cannot be
    decoded yet is kept until the cell size is known.

    Attributes:
        is_needed: whether a map is needed, by its run id; others are not decoded, which takes as
            long as many ticks on large terrains.
    """

    def __init__(
        self,
        take: Callable[[Keyframe], object],
        reject: Callable[[str, str], None],
        *,
        simulation_namespace: str,
        guess: bool = False,
    ) -> None:
        """
        Args:
            take: called with each keyframe; may raise ExchangeError.
            reject: called with topic and reason of a message that cannot be decoded or used.
            simulation_namespace: namespace of the soil node.
            guess: estimate the cell size from the map while it is not known.
        """
        self._take, self._reject = take, reject
        self._map_topic = resolve(topics.TERRAIN_MAP, simulation_namespace)
        self._tiles_topic = resolve(topics.TERRAIN_TILES, simulation_namespace)
        self._guess = guess
        self.is_needed: Callable[[int], bool] = lambda run_id: True
        self._cell: float | None = None
        self._pending: Rows | None = None  # points of a map
        self._tiles = TileAssembly()
        self._last_tile_time = 0.0  # or that of the subscription, monotonic clock [s]
        self._triggers = True

    def subscribe(self, poller: SubscriptionPoller, *, triggers: bool = True) -> None:
        """Begin to receive terrain, with that of the present.

        Args:
            poller: poller of the node.
            triggers: whether a map triggers a poll. A tile does: tiles may arrive after the last
                message that does so otherwise, as while time stands still.
        """
        self._triggers, self._last_tile_time = triggers, time.monotonic()
        subscribe: Any = poller.subscribe
        subscribe(
            PointCloud2, self._map_topic, qos.TRANSIENT_LOCAL, self.read_map, triggers=triggers
        )
        subscribe(
            PointCloud2, self._tiles_topic, qos.TILES, self.read_tile, triggers=True, raw=True
        )

    def check(self, poller: SubscriptionPoller, *, is_missing: bool = False) -> None:
        """Subscribe again if a round of tiles remains incomplete: a new subscriber is sent all.

        Call it now and then while subscribed; not in a callback of a message.

        Args:
            poller: poller of the node.
            is_missing: whether tiles are awaited although no round is incomplete.
        """
        is_missing = is_missing or self._tiles.is_incomplete
        if is_missing and time.monotonic() - self._last_tile_time > _MAX_TILE_GAP:
            triggers = self._triggers
            self.unsubscribe(poller)
            self.subscribe(poller, triggers=triggers)

    def unsubscribe(self, poller: SubscriptionPoller) -> None:
        """End to receive terrain."""
        poller.unsubscribe(self._map_topic)
        poller.unsubscribe(self._tiles_topic)
        self._tiles.clear()

    def read_map(self, msg: PointCloud2) -> None:
        """Decode a map, or keep it until the cell size is known."""
        try:
            self._read_cells(cells_of_terrain_cloud(msg))
        except ExchangeError as error:
            self._reject(self._map_topic, error.coded_message)

    def read_tile(self, data: bytes) -> None:
        """Add a serialised tile, and decode the map if it is complete."""
        self._last_tile_time = time.monotonic()
        try:
            tile = tile_from_cdr(data)
            if not self.is_needed(tile.round.run_id):
                self._tiles.clear()
            elif self._tiles.add(tile) and self._tiles.cells is not None:
                cells = self._tiles.cells
                self._tiles.clear()  # they are large, and the next full round replaces them
                self._read_cells(cells)
        except ExchangeError as error:
            self._reject(self._tiles_topic, error.coded_message)

    def set_cell(self, cell: float) -> None:
        """Set the cell size [m] and decode the map that was kept."""
        self._cell = cell
        if self._pending is not None:
            try:
                self._read_cells(self._pending)
            except ExchangeError as error:
                self._reject(self._map_topic, error.coded_message)

    def _read_cells(self, cells: Rows) -> None:
        """Decode the points of a map, or keep them until the cell size is known.

        Raises:
            ExchangeError: they are invalid, or cannot be used.
        """
        is_needed = self.is_needed(int(cells["run_id"][0, 0]))
        self._pending = cells if is_needed else None
        if self._pending is None or (self._cell is None and not self._guess):
            return
        keyframe = keyframe_of_cells(cells, cell=self._cell)
        self._pending = None
        self._take(keyframe)
