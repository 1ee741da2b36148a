"""A message of any type as bytes, and the newest messages of a transient-local topic."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from msg_bridge.contract.interface import is_exclusive

__all__ = ["ReceivedMessage", "TransientLocalHistory"]


class ReceivedMessage(NamedTuple):
    """A received message.

    Attributes:
        topic: its topic.
        data: its CDR bytes.
        received_time, source_time: wall times of reception and publication [ns].
        sequence_number: that of its publisher, from 1; 0 if unknown.
    """

    topic: str
    data: bytes
    received_time: int
    source_time: int
    sequence_number: int


class TransientLocalHistory:
    """The newest messages of a transient-local topic, as many as it has publishers.

    Messages do not identify their publisher, so with several publishers the newest message of one
    may displace that of another.

    Attributes:
        messages: the messages, the oldest first.
    """

    def __init__(self, topic: str) -> None:
        """
        Args:
            topic: name of the topic. If only one node may publish it, a second publisher is that of
                a node that was killed and restarted: its last message is not kept.
        """
        self._is_exclusive = is_exclusive(topic)
        self.messages: deque[ReceivedMessage] = deque(maxlen=1)

    def set_depth(self, num_publishers: int) -> None:
        """Keep one message per publisher, at least one."""
        depth = 1 if self._is_exclusive else max(num_publishers, 1)
        if depth != self.messages.maxlen:
            self.messages = deque(self.messages, maxlen=depth)
