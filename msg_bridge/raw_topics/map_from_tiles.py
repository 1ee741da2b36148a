"""Make `/terrain/map` of a large terrain, which its soil node publishes as tiles only.

A bag has maps then as that of any other terrain, in full and as differences, for the same tools.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msg_bridge.bag.metadata import OfferedQos
from msg_bridge.codec.cdr import rows_to_cdr
from msg_bridge.codec.cdr_primitives import LITTLE_ENDIAN, STAMP
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.stamps import stamp_from_nanoseconds
from msg_bridge.codec.terrain_tiles import TerrainTile, tile_from_cdr
from msg_bridge.codec.tile_assembly import TileAssembly
from msg_bridge.contract import topics
from msg_bridge.contract.constants import MAX_MAP_CELLS
from msg_bridge.contract.topics import MAP_FRAME
from msg_bridge.raw_topics.received_message import ReceivedMessage

__all__ = ["MAP_QOS", "MapFromTiles", "is_tiles_topic", "min_map_period"]

MAP_QOS = OfferedQos(durability="transient_local", history="keep_last", depth=1)
"""QoS of `/terrain/map`, for players."""

_NANO = 10**9


def min_map_period(num_cells: int) -> float:
    """Return the minimum simulation time between two recorded maps of a large terrain [s].

    Args:
        num_cells: number of columns of the terrain.
    """
    return 0.5 * max(1.0, num_cells / MAX_MAP_CELLS)


def is_tiles_topic(topic: str) -> bool:
    """Return whether a topic has the tiles of a terrain, in any namespace."""
    return topic.endswith(f"/{topics.TERRAIN_TILES}")


class _Maps:
    """The maps of one topic.

    Attributes:
        tiles: the map.
        stamp: stamp of the last map that was made [ns]; None before the first.
        num_made: number of maps that were made.
    """

    def __init__(self) -> None:
        self.tiles = TileAssembly()
        self.stamp: int | None = None
        self.num_made = 0


class MapFromTiles:
    """Converts messages on `/terrain/tiles` to messages on `/terrain/map`."""

    def __init__(self) -> None:
        self._maps: dict[str, _Maps] = {}  # by topic of the tiles

    def convert(self, messages: Sequence[ReceivedMessage]) -> Iterator[ReceivedMessage]:
        """Yield a map when all its tiles have arrived; malformed tiles are skipped.

        Args:
            messages: received messages of any topic, in their order.
        """
        for message in messages:
            if not is_tiles_topic(message.topic):
                continue
            try:
                tile = tile_from_cdr(message.data)
            except CodecError:
                continue
            maps = self._maps.setdefault(message.topic, _Maps())
            run_before = maps.tiles.run_id
            if maps.tiles.add(tile) and self._is_due(maps, tile, run_before, message.data):
                yield self._make(maps, message)

    def _is_due(self, maps: _Maps, tile: TerrainTile, run_before: int, data: bytes) -> bool:
        """Return whether a map is due: the first of a run, and one a period after the last."""
        rows, cols = tile.round.shape
        period = round(min_map_period(rows * cols) * _NANO)
        stamp = _stamp_ns(data)
        is_same_run = run_before == tile.round.run_id and maps.stamp is not None
        if is_same_run and 0 <= stamp - (maps.stamp or 0) < period:
            return False
        maps.stamp = stamp
        return True

    def _make(self, maps: _Maps, message: ReceivedMessage) -> ReceivedMessage:
        cells = maps.tiles.cells
        assert cells is not None
        stamp = stamp_from_nanoseconds(_stamp_ns(message.data))
        data = rows_to_cdr(cells.reshape(-1), MAP_FRAME, stamp, height=cells.shape[0])
        maps.num_made += 1
        topic = message.topic.removesuffix(topics.TERRAIN_TILES) + topics.TERRAIN_MAP
        return ReceivedMessage(
            topic, data, message.received_time, message.source_time, maps.num_made
        )


def _stamp_ns(data: bytes) -> int:
    seconds, nanoseconds = STAMP.unpack_from(data, len(LITTLE_ENDIAN))
    return int(seconds) * _NANO + int(nanoseconds)
