"""The ticks of the soil in one run of a bag: its headers and ledgers."""

from __future__ import annotations

from collections import deque
from typing import Any

from earthmoving_sim.replay.errors import ReplayError
from earthmoving_sim.replay.recorded.run_survey import MAX_END_LAG
from earthmoving_sim.replay.recorded.topic_queues import TopicQueues
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.tick_headers import from_multi_array
from msg_bridge.contract import topics
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import SoilHeader

__all__ = ["LEDGER_TOPIC", "SOIL_TICK_TOPIC", "SOIL_TOPICS", "RecordedSoil"]

SOIL_TICK_TOPIC = f"/{topics.SOIL_TICK}"
LEDGER_TOPIC = f"/{topics.SOIL_LEDGER}"
SOIL_TOPICS = dict.fromkeys((SOIL_TICK_TOPIC, LEDGER_TOPIC), "std_msgs/msg/Int64MultiArray")
"""Type of each topic that is read, by its name."""


class RecordedSoil:
    """The ticks of one run, in order.

    Attributes:
        tick: last tick that was read; -1 before the first.
    """

    def __init__(self, queues: TopicQueues, run_id: int) -> None:
        """
        Args:
            queues: messages of the bag.
            run_id: number of the run.
        """
        self._queues, self._run_id = queues, run_id
        self.tick = -1
        self._ledger: Ledger | None = None  # read, and not before the present tick
        self._headers: deque[SoilHeader] = deque()  # read ahead of the present tick

    def skip_through(self, tick: int) -> None:
        """Leave out the ticks up to one."""
        self.tick = tick

    def next_tick(self) -> tuple[SoilHeader, Ledger | None] | None:
        """Return the header of the next tick, and its ledger unless the bag lacks it.

        Returns:
            None at the end of the run. The last ticks without a ledger are not part of it, unless
            they are more than a recorder that is stopped leaves.

        Raises:
            ReplayError: the bag lacks the header.
            BagReadError: the bag is damaged.
        """
        header = self._next_header()
        if header is None:
            return None
        if header.tick != self.tick + 1:
            raise ReplayError(
                f"the bag lacks tick {self.tick + 1} of run {self._run_id} on {SOIL_TICK_TOPIC};"
                " record from the begin of the run, without loss"
            )
        self.tick = header.tick
        while self._ledger is None or self._ledger.tick < header.tick:
            is_first_without = self._ledger is not None
            self._ledger = self._next(LEDGER_TOPIC, Ledger, header.tick)
            if self._ledger is None:
                return None if is_first_without and self._is_near_end() else (header, None)
        return header, self._ledger if self._ledger.tick == header.tick else None

    def _next_header(self) -> SoilHeader | None:
        if self._headers:
            return self._headers.popleft()
        return self._next(SOIL_TICK_TOPIC, SoilHeader, self.tick + 1)

    def _is_near_end(self) -> bool:
        """Return whether fewer than `MAX_END_LAG` headers follow; they are kept."""
        while len(self._headers) < MAX_END_LAG:
            last = self._headers[-1].tick if self._headers else self.tick
            header = self._next(SOIL_TICK_TOPIC, SoilHeader, last + 1)
            if header is None:
                return True
            self._headers.append(header)
        return False

    def _next(self, topic: str, kind: type[Any], first_tick: int) -> Any | None:
        """Return the next header or ledger of the run that is not of an earlier tick: those are
        repeated ones."""
        while (message := self._queues.next(topic)) is not None:
            try:
                found = from_multi_array(message)
            except CodecError:
                continue
            if not isinstance(found, kind) or found.run_id < self._run_id:
                continue
            if found.run_id > self._run_id:  # what follows is not kept in memory
                return None
            if found.tick >= first_tick:
                return found
        return None
