"""A node on every topic of the exchange that receives all messages, and sends forged ones.

The kinds of forged messages are in `forgeries`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Int64MultiArray, String

from msg_bridge.codec import qos
from msg_bridge.codec.row_chunks import chunk_to_cdr
from msg_bridge.codec.tick_headers import message_to_cdr, to_join_rejected_string
from msg_bridge.contract import topics
from msg_bridge.contract.messages import (
    JoinRejected,
    MachineHeader,
    RetransmitRequest,
    RowChunk,
    SoilHeader,
    Stream,
)
from msg_bridge.contract.topics import MAP_FRAME, STREAM_TOPICS, resolve
from msg_bridge.nodes.message_decoding import decode_array, decode_chunk

__all__ = ["Forger", "Forgery"]

MACHINE = "/excavator"

_ROW_TOPICS = {
    stream: resolve(
        STREAM_TOPICS[stream] if stream is not Stream.BACKLOG else topics.CONVERSION_BACKLOG,
        MACHINE if stream is Stream.BACKLOG else "/",
    )
    for stream in (
        Stream.SWEEP,
        Stream.DEPOSIT_REQUEST,
        Stream.CONVERSION,
        Stream.MAP_UPDATE,
        Stream.FORCE,
        Stream.BACKLOG,
    )
}
_MACHINE_TICK = resolve(topics.MACHINE_TICK, MACHINE)
_SOIL_TICK = resolve(topics.SOIL_TICK, "/")
_REJECTIONS = resolve(topics.SOIL_JOIN_REJECTIONS, "/")
_MAP, _CONFIG = resolve(topics.TERRAIN_MAP, "/"), resolve(topics.SIM_CONFIG, "/")

_TYPES: dict[str, Any] = {
    **dict.fromkeys(_ROW_TOPICS.values(), PointCloud2),
    _MACHINE_TICK: Int64MultiArray,
    _SOIL_TICK: Int64MultiArray,
    _REJECTIONS: String,
    _MAP: PointCloud2,
    _CONFIG: String,
}
"""Every topic of the exchange with its type."""

Forgery = Callable[["Forger"], None]
"""Sends forged messages through a forger."""


class Forger(Node):
    """Node that receives and forges messages of the exchange.

    Attributes:
        rng: generator of all choices.
        sent: number of forged messages by kind.
    """

    def __init__(self, *, seed: int = 0, **kwargs: Any) -> None:
        super().__init__("forger", **kwargs)
        self.rng = np.random.default_rng(seed)
        self.sent: Counter[str] = Counter()
        self._history: dict[str, list[bytes]] = {}
        self._forged: set[bytes] = set()
        # Not the name `_publishers`: rclpy's Node has it.
        self._senders: dict[str, Publisher] = {}
        for topic, kind in _TYPES.items():
            is_state = topic in (_MAP, _CONFIG)
            profile = qos.TRANSIENT_LOCAL if is_state else qos.ROWS
            self._senders[topic] = self.create_publisher(kind, topic, profile)
            self.create_subscription(kind, topic, partial(self._keep, topic), profile, raw=True)

    def _keep(self, topic: str, data: bytes) -> None:
        if data in self._forged:
            return
        history = self._history.setdefault(topic, [])
        history.append(data)
        del history[:-50]

    @property
    def has_all_numbers(self) -> bool:
        """Whether headers of both ends have been received."""
        return _SOIL_TICK in self._history and _MACHINE_TICK in self._history

    def forge(self, name: str, send: Forgery) -> None:
        """Send a forged message, and count it.

        Args:
            name: name of its kind.
            send: called with this node; sends one message or more.
        """
        send(self)
        self.sent[name] += 1

    def publish(self, topic: str, data: bytes) -> None:
        """Send bytes as they are."""
        self._forged.add(data)
        self._senders[topic].publish(data)

    def random_topic(self) -> str:
        """Return a topic on which a message has been received."""
        return str(self.rng.choice(sorted(self._history)))

    def latest(self, topic: str) -> bytes:
        return self._history[topic][-1]

    def earlier(self, topic: str) -> bytes:
        """Return a message of an earlier tick."""
        return self._history[topic][0]

    def soil_header(self) -> SoilHeader:
        """Return the latest header of the soil."""
        for data in reversed(self._history[_SOIL_TICK]):
            message = decode_array(data)
            if isinstance(message, SoilHeader):
                return message
        raise LookupError("no header of the soil")

    def machine_header(self) -> MachineHeader:
        """Return the latest header of the machine."""
        for data in reversed(self._history[_MACHINE_TICK]):
            message = decode_array(data)
            if isinstance(message, MachineHeader):
                return message
        raise LookupError("no header of the machine")

    def chunk(self, stream: Stream) -> RowChunk | None:
        """Return the latest rows of a stream."""
        history = self._history.get(_ROW_TOPICS[stream])
        return decode_chunk(history[-1], stream) if history else None

    def send_rows(self, chunk: RowChunk) -> None:
        self.publish(_ROW_TOPICS[chunk.stream], chunk_to_cdr(chunk, MAP_FRAME, Time()))

    def send_header(self, message: MachineHeader | SoilHeader | RetransmitRequest) -> None:
        is_soil = isinstance(message, SoilHeader)
        self.publish(_SOIL_TICK if is_soil else _MACHINE_TICK, message_to_cdr(message))

    def send_rejection(self, rejection: JoinRejected) -> None:
        self._send_text(_REJECTIONS, to_join_rejected_string(rejection))

    def send_configuration(self, text: str) -> None:
        self._send_text(_CONFIG, String(data=text))

    def _send_text(self, topic: str, text: String) -> None:
        self.publish(topic, bytes(serialize_message(text)))
