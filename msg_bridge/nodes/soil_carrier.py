"""Carries the soil's exchange over topics, to machines that are found by their topics."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Int64MultiArray, String

from msg_bridge.codec import qos
from msg_bridge.codec.chunks import chunk_to_cdr
from msg_bridge.codec.headers import message_to_cdr, to_refusal_string
from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import (
    Keyframe,
    MachineHeader,
    Message,
    Refusal,
    Resend,
    RowChunk,
    Stream,
    Verb,
)
from msg_bridge.nodes.inbox import Inbox
from msg_bridge.nodes.topics import (
    MAP_FRAME,
    OWED_TOPIC,
    REFUSALS_TOPIC,
    SOIL_TICK_TOPIC,
    STREAM_TOPIC,
    TICK_TOPIC,
    namespace_of,
)
from msg_bridge.nodes.wire import read_array, read_chunk

__all__ = ["SoilCarrier"]

_SENT = (Stream.CONVERSION, Stream.CHANGED, Stream.FORCE)
_RECEIVED = (Stream.SWEEP, Stream.LANDED)

_SCAN_PERIOD = 0.2
"""Time between looks for machines that are not known yet [s, wall]."""


class SoilCarrier:
    """Topics of the exchange as the soil uses them.

    Attributes:
        machines: namespace of each machine heard of, by source.
        heard: wall clock [s, monotonic] at which each source was last heard.
    """

    def __init__(
        self,
        node: Node,
        inbox: Inbox,
        receive: Callable[[Message], None],
        send_keyframe: Callable[[Keyframe], None],
        refuse: Callable[[str, str], None],
    ) -> None:
        """
        Args:
            node: whose topics they are.
            inbox: of the node, for what machines send.
            receive: takes each message; may raise ExchangeError.
            send_keyframe: publishes the terrain, with all its layers.
            refuse: told topic and reason of a message that cannot be taken.
        """
        self.machines: dict[int, str] = {}
        self.heard: dict[int, float] = {}
        self._node, self._inbox = node, inbox
        self._receive = receive
        self._send_keyframe = send_keyframe
        self._refuse = refuse
        self._owed: dict[str, Publisher] = {}  # by namespace
        self._tick = node.create_publisher(Int64MultiArray, TICK_TOPIC, qos.ROWS)
        self._refusals = node.create_publisher(String, REFUSALS_TOPIC, qos.ROWS)
        self._rows = {
            stream: node.create_publisher(PointCloud2, STREAM_TOPIC[stream], qos.ROWS)
            for stream in _SENT
        }
        for stream in _RECEIVED:
            topic = STREAM_TOPIC[stream]
            take = partial(self._take_rows, topic, stream)
            # A machine's header comes after the rows that it counts.
            inbox.subscribe(PointCloud2, topic, qos.ROWS, take, wakes=False, raw=True)
        node.create_timer(_SCAN_PERIOD, self._scan)
        self._scan()

    def send(self, messages: Iterable[Message], stamp: Time) -> None:
        """Publish what the soil has to say; rows are stamped with the end of their tick."""
        for message in messages:
            if isinstance(message, RowChunk):
                self._rows_publisher(message).publish(chunk_to_cdr(message, MAP_FRAME, stamp))
            elif isinstance(message, Keyframe):
                self._send_keyframe(message)
            elif isinstance(message, Refusal):
                self._refusals.publish(to_refusal_string(message))
            else:
                self._tick.publish(message_to_cdr(message))

    def _rows_publisher(self, chunk: RowChunk) -> Publisher:
        if chunk.stream is Stream.OWED:
            return self._owed[self.machines[chunk.source]]
        return self._rows[chunk.stream]

    def _scan(self) -> None:
        """Listen to machines that have appeared."""
        for topic, _ in self._node.get_topic_names_and_types():
            namespace = namespace_of(topic)
            if namespace is not None and namespace not in self._owed:
                self._listen(namespace)

    def _listen(self, namespace: str) -> None:
        topic = f"{namespace}/{SOIL_TICK_TOPIC}"
        owed = f"{namespace}/{OWED_TOPIC}"
        self._owed[namespace] = self._node.create_publisher(PointCloud2, owed, qos.ROWS)
        take = partial(self._take_word, topic, namespace)
        self._inbox.subscribe(Int64MultiArray, topic, qos.ROWS, take, raw=True)

    def _take_rows(self, topic: str, stream: Stream, data: bytes) -> None:
        self._take(topic, lambda: read_chunk(data, stream))

    def _take_word(self, topic: str, namespace: str, data: bytes) -> None:
        self._take(topic, lambda: self._word_of(namespace, data))

    def _word_of(self, namespace: str, data: bytes) -> Message:
        message = read_array(data)
        if not isinstance(message, (MachineHeader, Resend)):
            raise ExchangeError(f"a {type(message).__name__} is nothing a machine says here")
        owner = self.machines.get(message.source, namespace)
        if owner != namespace and self._node.count_publishers(f"{owner}/{SOIL_TICK_TOPIC}"):
            reason = f"source {message.source} is {owner}; give {namespace} another `source`"
            if isinstance(message, MachineHeader) and message.verb in (Verb.JOIN, Verb.RETURN):
                no = Refusal(message.epoch, message.source, message.life, reason)
                self._refusals.publish(to_refusal_string(no))
            raise ExchangeError(reason)
        self.machines[message.source] = namespace
        return message

    def _take(self, topic: str, decode: Callable[[], Any]) -> None:
        try:
            message = decode()
            self.heard[message.source] = time.monotonic()
            self._receive(message)
        except ExchangeError as error:
            self._refuse(topic, str(error))
