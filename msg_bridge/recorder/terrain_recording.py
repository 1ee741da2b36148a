"""Which terrain maps are recorded in full, and which as their difference from a full one."""

from __future__ import annotations

from msg_bridge.codec.terrain_delta import encode_delta

__all__ = ["TerrainRecording"]


class TerrainRecording:
    """The maps of one topic."""

    def __init__(self, keyframe_period: int) -> None:
        """
        Args:
            keyframe_period: log time after which a map is recorded in full again [ns].
        """
        self._period = keyframe_period
        self._keyframe = b""
        self._keyframe_time: int | None = None  # log time [ns]

    def is_keyframe_due(self, log_time: int) -> bool:
        """Return whether the next map is recorded in full.

        Log times may begin again, after a reset of the simulation time.

        Args:
            log_time: the current log time [ns].
        """
        last = self._keyframe_time
        return last is None or abs(log_time - last) >= self._period

    def add_keyframe(self, data: bytes, log_time: int) -> None:
        """Note a serialised map that was recorded in full."""
        self._keyframe, self._keyframe_time = data, log_time

    def delta(self, data: bytes, log_time: int) -> bytes | None:
        """Return a serialised map as a delta; None if it is to be recorded in full."""
        return None if self.is_keyframe_due(log_time) else encode_delta(self._keyframe, data)

    def begin_file(self) -> None:
        """Have the next map recorded in full: a file must be readable without those before."""
        self._keyframe_time = None
