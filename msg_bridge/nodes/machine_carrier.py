"""Carries a machine's exchange over topics: the same messages as the direct transport."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Int64MultiArray, String

from msg_bridge.codec import qos
from msg_bridge.codec.chunks import chunk_to_cdr
from msg_bridge.codec.headers import from_refusal_string, message_to_cdr
from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import Message, Resend, RowChunk, SoilHeader, Stream
from msg_bridge.nodes.inbox import Inbox
from msg_bridge.nodes.map_reader import MapReader
from msg_bridge.nodes.topics import (
    MAP_FRAME,
    MAP_TOPIC,
    OWED_TOPIC,
    REFUSALS_TOPIC,
    SOIL_TICK_TOPIC,
    STREAM_TOPIC,
    TICK_TOPIC,
)
from msg_bridge.nodes.wire import read_array, read_chunk

__all__ = ["MachineCarrier"]

_SENT = (Stream.SWEEP, Stream.LANDED)
_RECEIVED = (Stream.CONVERSION, Stream.CHANGED, Stream.FORCE)


class MachineCarrier:
    """Topics of the exchange as a machine uses them.

    Attributes:
        maps: to be told the side length of a column once that is known.
    """

    def __init__(
        self,
        node: Node,
        inbox: Inbox,
        receive: Callable[[Message], None],
        refuse: Callable[[str, str], None],
    ) -> None:
        """
        Args:
            node: whose topics they are; `soil_tick` and `soil_owed` lie in its namespace.
            inbox: of the node, for what the soil sends.
            receive: takes each message; may raise ExchangeError.
            refuse: told topic and reason of a message that cannot be taken.
        """
        self._receive = receive
        self._refuse = refuse
        self.maps = MapReader(lambda keyframe: self._receive(keyframe), refuse)
        self._tick = node.create_publisher(Int64MultiArray, SOIL_TICK_TOPIC, qos.ROWS)
        self._rows = {
            stream: node.create_publisher(PointCloud2, STREAM_TOPIC[stream], qos.ROWS)
            for stream in _SENT
        }

        def subscribe(
            kind: Any,
            topic: str,
            profile: Any,
            decode: Callable[[Any], Message],
            *,
            wakes: bool = True,
            raw: bool = True,
        ) -> None:
            take = partial(self._take, topic, decode)
            inbox.subscribe(kind, topic, profile, take, wakes=wakes, raw=raw)

        subscribe(Int64MultiArray, TICK_TOPIC, qos.ROWS, _soil_word)
        for stream in _RECEIVED:
            decode = partial(read_chunk, stream=stream)
            # The header comes after the rows that it counts.
            subscribe(PointCloud2, STREAM_TOPIC[stream], qos.ROWS, decode, wakes=False)
        owed = partial(read_chunk, stream=Stream.OWED)
        subscribe(PointCloud2, OWED_TOPIC, qos.ROWS, owed)
        subscribe(String, REFUSALS_TOPIC, qos.ROWS, from_refusal_string, raw=False)
        inbox.subscribe(PointCloud2, MAP_TOPIC, qos.LATCHED, self.maps.read)

    def send(self, messages: Iterable[Message], stamp: Time) -> None:
        """Publish what the machine has to say; rows are stamped with the end of their tick."""
        for message in messages:
            if isinstance(message, RowChunk):
                self._rows[message.stream].publish(chunk_to_cdr(message, MAP_FRAME, stamp))
            else:
                self._tick.publish(message_to_cdr(message))  # type: ignore[arg-type]

    def _take(self, topic: str, decode: Callable[[Any], Message], msg: Any) -> None:
        try:
            self._receive(decode(msg))
        except ExchangeError as error:
            self._refuse(topic, str(error))


def _soil_word(data: bytes) -> Message:
    message = read_array(data)
    if not isinstance(message, (SoilHeader, Resend)):
        raise ExchangeError(f"a {type(message).__name__} is nothing the soil says here")
    return message
