"""Maps read by the side length of a column, whichever of the two is heard first."""

from __future__ import annotations

from collections.abc import Callable

from sensor_msgs.msg import PointCloud2

from msg_bridge.codec.terrain import keyframe_from_terrain_cloud
from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import Keyframe

__all__ = ["MapDecoder"]


class MapDecoder:
    """Takes messages of `/terrain/map`.

    A map has float32 positions, which do not tell every side length exactly; `/sim/config` does.
    That is another topic and may be heard later, in the first run and when a soil with other cells
    takes the place of the last one, and a map is not told again before anything changes. So one
    that cannot be read is kept until the side length is known.
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
            take: takes each terrain; may raise ExchangeError.
            refuse: told topic and reason of a map that cannot be read or taken.
            guess: whether to find the side length from the map itself while it is not known, for
                who may never be told it.
        """
        self._take, self._reject = take, reject
        self.topic = topic
        self._guess = guess
        self._cell: float | None = None
        self._pending_map: PointCloud2 | None = None

    def read(self, msg: PointCloud2) -> None:
        """Take a map, or keep it."""
        self._pending_map = msg
        if self._cell is None and not self._guess:
            return
        try:
            keyframe = keyframe_from_terrain_cloud(msg, cell=self._cell)
            self._pending_map = None
            self._take(keyframe)
        except ExchangeError as error:
            self._reject(self.topic, str(error))

    def set_cell(self, cell: float) -> None:
        """Take the side length of a column [m], and the map that was kept for it."""
        self._cell = cell
        if self._pending_map is not None:
            self.read(self._pending_map)
