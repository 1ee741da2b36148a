"""FrameStream: the messages that bring one client up to date, within a budget of bytes.

Each client gets the newest state, regardless of what it has missed. A tile is sent when its change
counter is newer than what the client has, so after a pause a client gets the newest content of each
changed tile once.
"""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from viewer.scene.terrain_tiles import TILE, TerrainTiles
from viewer.server.encoding import SceneEncoder
from viewer.server.packing import pack, pack_map

__all__ = ["FRAME_BUDGET", "MAX_UNACKNOWLEDGED", "FrameStream"]

MAX_UNACKNOWLEDGED = 2
"""Maximum number of frames that a client has not acknowledged."""

FRAME_BUDGET = 230_000
"""Target size of particles and tiles in a frame [bytes]."""

_MIN_TILE_BUDGET = 60_000
"""Size of tiles in a frame [bytes] that particles leave at least."""

_OLDEST_SHARE = 0.25
"""Fraction of the tiles that is chosen by age rather than by distance to a machine."""

_HEARTBEAT = 0.5
"""Wall time after which a frame is sent although nothing has changed [s]."""

_ACK_TIME = 2.0
"""Wall time without an acknowledgement after which a frame is sent nevertheless [s]; twice as
long after each such frame."""

_LATENCY_WEIGHT = 0.2


class FrameStream:
    """What one client has, and what it lacks.

    Attributes:
        latency: time from sending a frame to its acknowledgement, averaged [s].
        seq: number of the last frame.
    """

    def __init__(
        self,
        encoder: SceneEncoder,
        now: Callable[[], float] = time.monotonic,
        *,
        budget: int = FRAME_BUDGET,
    ) -> None:
        """
        Args:
            encoder: of the scene.
            now: a monotonic wall clock [s].
            budget: target size of particles and tiles in a frame [bytes].
        """
        self.latency = 0.0
        self._budget = budget
        self.seq = 0
        self._encoder, self._now = encoder, now
        self._unacknowledged: OrderedDict[int, float] = OrderedDict()  # time sent by number
        self._site_version: tuple[int, int] | None = None
        self._models: dict[str, int] = {}
        self._tiles: TerrainTiles | None = None
        self._sent: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        self._particles_version = -1
        self._version = -1
        self._last_frame = self._last_ack = -np.inf
        self._ack_time = _ACK_TIME

    @property
    def can_send(self) -> bool:
        """Whether the client has acknowledged enough frames, or an acknowledgement may be lost."""
        return len(self._unacknowledged) < MAX_UNACKNOWLEDGED or self._is_overdue

    @property
    def _is_overdue(self) -> bool:
        return self._now() - max(self._last_frame, self._last_ack) >= self._ack_time

    def acknowledge(self, seq: int) -> bool:
        """Process an acknowledgement; return whether that frame was waiting for one.

        Frames are applied in order, so earlier ones are acknowledged too.
        """
        if seq not in self._unacknowledged:
            return False
        latency = self._now() - self._unacknowledged[seq]
        weight = 1.0 if self.latency == 0.0 else _LATENCY_WEIGHT
        self.latency += weight * (latency - self.latency)
        self._last_ack = self._now()
        # Over a slow link, acknowledgements are late, not lost: more frames would add to the lag.
        self._ack_time = max(_ACK_TIME, 2.0 * latency)
        while self._unacknowledged and next(iter(self._unacknowledged)) <= seq:
            self._unacknowledged.popitem(last=False)
        return True

    def next_messages(self) -> list[bytes]:
        """Return the messages to send now: none, or a frame and what must precede it."""
        if not self.can_send:
            return []
        scene = self._encoder.scene
        with scene.lock:
            if scene.is_restoring:
                return []
            is_new = scene.version != self._version or self._has_due_tiles()
            if not is_new and self._now() - self._last_frame < _HEARTBEAT:
                return []
            self._version = scene.version
            return [*self._site(), *self._machines(), self._frame()]

    def _has_due_tiles(self) -> bool:
        return self._tiles is not None and bool((self._tiles.changed > self._sent).any())

    def _site(self) -> list[bytes]:
        """Return the site if the client lacks it; all tiles are due again then."""
        encoder = self._encoder
        if self._site_version == encoder.site_version:
            return []
        self._tiles = encoder.scene.terrain.tiles
        count = 0 if self._tiles is None else self._tiles.changed.size
        self._sent = np.zeros(count, dtype=np.int64)
        message = encoder.site()
        if message is None:
            return []
        self._site_version = encoder.site_version
        return [message]

    def _machines(self) -> list[bytes]:
        encoder = self._encoder
        present = {
            name: view.model_version
            for name, view in encoder.scene.machines.items()
            if view.model is not None
        }
        gone = [name for name in self._models if name not in present]
        changed = [name for name, version in present.items() if self._models.get(name) != version]
        self._models = present
        return [
            *(pack({"type": "machine_gone", "id": name}) for name in gone),
            *(encoder.machine(name) for name in changed),
        ]

    def _frame(self) -> bytes:
        encoder, scene = self._encoder, self._encoder.scene
        if len(self._unacknowledged) >= MAX_UNACKNOWLEDGED:
            self._ack_time *= 2.0
        self.seq += 1
        parts = {
            "type": pack("frame"),
            "seq": pack(self.seq),
            "latency_ms": pack(1e3 * self.latency),
            **encoder.common(),
        }
        budget = self._budget
        if scene.particles_version != self._particles_version:
            parts["particles"], size = encoder.particles()
            self._particles_version = scene.particles_version
            budget = max(budget - size, _MIN_TILE_BUDGET)
        numbers = self._due_tiles(budget // TILE.itemsize)
        parts["tiles"] = encoder.tiles(numbers)
        if self._tiles is not None:
            self._sent[numbers] = self._tiles.changed[numbers]
        self._last_frame = self._now()
        self._unacknowledged[self.seq] = self._last_frame
        return pack_map(parts)

    def _due_tiles(self, max_count: int) -> NDArray[np.intp]:
        """Return the tiles to send: those nearest to a machine first, and some of the oldest."""
        tiles = self._tiles
        if tiles is None:
            return np.zeros(0, dtype=np.intp)
        due = np.flatnonzero(tiles.changed > self._sent)
        if due.size <= max_count:
            return due
        num_oldest = round(_OLDEST_SHARE * max_count)
        by_age = np.argsort(tiles.changed[due], kind="stable")
        oldest, rest = due[by_age[:num_oldest]], due[by_age[num_oldest:]]
        nearest = rest[np.argsort(self._distance(tiles, rest), kind="stable")]
        return np.sort(np.concatenate([oldest, nearest[: max_count - num_oldest]]))

    def _distance(self, tiles: TerrainTiles, numbers: NDArray[np.intp]) -> NDArray[np.float64]:
        """Return the squared distance of tiles to the nearest machine [m^2]."""
        x, y = (values[numbers] for values in tiles.centers())
        positions = [
            view.position
            for view in self._encoder.scene.machines.values()
            if view.position is not None
        ] or [(0.0, 0.0)]
        squares = np.array([(x - px) ** 2 + (y - py) ** 2 for px, py in positions])
        nearest: NDArray[np.float64] = squares.min(axis=0)
        return nearest
