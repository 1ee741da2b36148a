"""The messages of a bag by topic: each in its own order, for any order between topics."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

from earthmoving_sim.replay.errors import ReplayError
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.cdr import cdr_to_array

__all__ = ["TopicQueues"]

_ARRAY_TYPE = "std_msgs/msg/Int64MultiArray"


class TopicQueues:
    """Queues of the messages of some topics, filled from the bag as far as they are needed.

    Memory holds the messages by which topics lag behind one another in the bag.
    """

    def __init__(self, reader: BagReader, topics: Mapping[str, str]) -> None:
        """
        Args:
            reader: the bag.
            topics: type of each topic by its name; those that the bag lacks have no messages.

        Raises:
            ReplayError: a topic has another type.
        """
        known = []
        for topic, type_name in topics.items():
            info = reader.topics.get(topic)
            if info is not None and info.type != type_name:
                raise ReplayError(f"{reader.path} has {info.type} on {topic}, not {type_name}")
            known += [] if info is None else [topic]
        self._reader = reader
        self._arrays = {topic for topic in known if topics[topic] == _ARRAY_TYPE}
        self._queues: dict[str, deque[tuple[int, bytes]]] = {topic: deque() for topic in known}
        self._messages = reader.raw_messages(known) if known else iter(())

    def next(self, topic: str) -> Any | None:
        """Return the next message of a topic and remove it; None at the end of the bag.

        Arrays of int64 are objects with the attributes of the message (`cdr_to_array`).

        Raises:
            BagReadError: the bag is damaged, or the message cannot be decoded.
        """
        queue = self._queues.get(topic)
        if queue is None:
            return None
        while not queue:
            found = next(self._messages, None)
            if found is None:
                return None
            name, time, data = found
            self._queues[name].append((time, data))
        time, data = queue.popleft()
        if topic in self._arrays and (array := cdr_to_array(data)) is not None:
            return array  # deserialised in a tenth of the time
        return self._reader.decode(topic, data, time)
