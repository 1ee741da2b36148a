"""Decode terrain maps with the exact cell size, whichever of map and cell size arrives first."""

from __future__ import annotations

from collections.abc import Callable

from sensor_msgs.msg import PointCloud2

from msg_bridge.codec.terrain import keyframe_from_terrain_cloud, run_id_of_terrain_cloud
from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import Keyframe

__all__ = ["MapDecoder"]


class MapDecoder:
    """Decoder of the messages on `terrain/map`.

    The float32 positions of a map do not determine every cell size exactly; `sim/config` has it.
    That topic may arrive later, in the first run and after a soil node with another cell size has
    started, and a map is not published again before the terrain changes. So a map that cannot be
    decoded yet is kept until the cell size is known.

    Attributes:
        topic: name of the map's topic.
        is_needed: whether a map is needed, by its run id; others are not decoded, which takes as
            long as many ticks on large terrains.
    """

    def __init__(
        self,
        take: Callable[[Keyframe], object],
        reject: Callable[[str, str], None],
        *,
        topic: str,
        guess: bool = False,
    ) -> None:
        """
        Args:
            take: called with each keyframe; may raise ExchangeError.
            reject: called with topic and reason of a map that cannot be decoded or used.
            topic: name of the map's topic.
            guess: estimate the cell size from the map while it is not known.
        """
        self._take, self._reject = take, reject
        self.topic = topic
        self._guess = guess
        self.is_needed: Callable[[int], bool] = lambda run_id: True
        self._cell: float | None = None
        self._pending_map: PointCloud2 | None = None

    def read(self, msg: PointCloud2) -> None:
        """Decode a map, or keep it until the cell size is known."""
        try:
            self._pending_map = msg if self.is_needed(run_id_of_terrain_cloud(msg)) else None
            if self._pending_map is None or (self._cell is None and not self._guess):
                return
            keyframe = keyframe_from_terrain_cloud(msg, cell=self._cell)
            self._pending_map = None
            self._take(keyframe)
        except ExchangeError as error:
            self._reject(self.topic, error.coded_message)

    def set_cell(self, cell: float) -> None:
        """Set the cell size [m] and decode the map that was kept."""
        self._cell = cell
        if self._pending_map is not None:
            self.read(self._pending_map)
