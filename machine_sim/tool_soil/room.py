"""Room of a tool for soil, as it is reported to the soil with the sweep of each tick.

The soil removes no more than the room of a tick. Its answers lag by one or two ticks, in which the
tool reports again: what it has reported and the soil has not answered yet counts as taken, or two
ticks would fill the same room twice. Each report is therefore only a part of the room that is left.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.rows import UNLIMITED_ROOM

__all__ = ["ReportedRoom"]

_REPORTED_FRACTION = 0.5
"""Part of the room left that a tick reports. With an answer to one tick outstanding, each tick can
take a third of the room: hundreds of litres while a bucket is not almost full."""


class ReportedRoom:
    """Reports of one tool that the soil has not answered yet."""

    def __init__(self, max_outstanding: int) -> None:
        """
        Args:
            max_outstanding: maximum number of ticks that are not answered.
        """
        self._outstanding: deque[int] = deque(maxlen=max_outstanding)

    @property
    def state(self) -> NDArray[np.int64]:
        """Reports that are not answered [mm^3], oldest first, for the state hash."""
        return np.array(self._outstanding, dtype=np.int64)

    def continue_from(self, other: ReportedRoom) -> None:
        """Take the reports of another tool."""
        self._outstanding.extend(other._outstanding)

    def receive_answer(self, ticks_ago: int) -> None:
        """Remove the reports up to that of the tick `ticks_ago` ticks ago, which is answered."""
        while len(self._outstanding) > ticks_ago:
            self._outstanding.popleft()

    def reset(self) -> None:
        """Remove all reports: the soil has answered them, or will not."""
        self._outstanding.clear()

    def report(self, free_mm3: float) -> int:
        """Return the room to report for a tick [mm^3].

        Args:
            free_mm3: bank volume that the tool can take in [mm^3], infinite without a limit, less
                the soil that the soil has credited.
        """
        if free_mm3 == np.inf:
            return UNLIMITED_ROOM
        left = max(free_mm3 - sum(self._outstanding), 0.0)
        # One less than the maximum, which is no limit.
        room = int(min(_REPORTED_FRACTION * left, UNLIMITED_ROOM - 1))
        self._outstanding.append(room)
        return room
