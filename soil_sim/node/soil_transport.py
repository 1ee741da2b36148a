"""Transport of the exchange over topics, at the soil; machine nodes are found by their topics."""

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
from msg_bridge.codec.exchange_key import ExchangeKey
from msg_bridge.codec.row_chunks import chunk_to_cdr
from msg_bridge.codec.tick_headers import message_to_cdr, to_join_rejected_string
from msg_bridge.contract import topics
from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.messages import (
    JoinRejected,
    Keyframe,
    KeyframeDue,
    MachineHeader,
    Message,
    RetransmitRequest,
    RowChunk,
    Stream,
    Verb,
)
from msg_bridge.contract.topics import (
    MAP_FRAME,
    STREAM_TOPICS,
    machine_node_namespace,
    resolve,
)
from msg_bridge.nodes.message_decoding import decode_array, decode_chunk
from msg_bridge.nodes.subscription_poller import SubscriptionPoller

__all__ = ["SoilTransport"]

_SENT_STREAMS = (Stream.CONVERSION, Stream.MAP_UPDATE, Stream.FORCE)
_RECEIVED_STREAMS = (Stream.SWEEP, Stream.DEPOSIT_REQUEST)

_DISCOVERY_PERIOD = 0.2
"""Wall clock time between searches for new machine nodes [s]."""


class SoilTransport:
    """Topics of the exchange at the soil.

    Attributes:
        machines: namespace of each known machine node, by machine id.
        last_message_times: monotonic wall clock [s] of the last message that shows that its machine
            is alive, by machine id.
    """

    def __init__(
        self,
        node: Node,
        poller: SubscriptionPoller,
        receive: Callable[[Message], bool],
        send_terrain: Callable[[], None],
        reject: Callable[[str, str], None],
        key: ExchangeKey | None = None,
    ) -> None:
        """
        Args:
            node: soil node.
            poller: poller of the node, for messages of machines.
            receive: called with each message; returns whether its machine can have sent it now,
                see `SoilExchange.receive`; may raise ExchangeError.
            send_terrain: publishes the present terrain.
            reject: called with topic and reason of a message that cannot be used.
            key: authenticates all messages but the terrain; None: they are not authenticated.
        """
        self.machines: dict[int, str] = {}
        self.last_message_times: dict[int, float] = {}
        self._node, self._poller = node, poller
        self._receive = receive
        self._send_terrain = send_terrain
        self._reject = reject
        self._key = key
        self._backlog_publishers: dict[str, Publisher] = {}  # by namespace
        self._tick = node.create_publisher(Int64MultiArray, topics.SOIL_TICK, qos.ROWS)
        self._rejections = node.create_publisher(String, topics.SOIL_JOIN_REJECTIONS, qos.ROWS)
        self._rows = {
            stream: node.create_publisher(PointCloud2, STREAM_TOPICS[stream], qos.ROWS)
            for stream in _SENT_STREAMS
        }
        for stream in _RECEIVED_STREAMS:
            topic = STREAM_TOPICS[stream]
            take = partial(self._take_rows, topic, stream)
            # The header of a machine follows the rows that it counts.
            poller.subscribe(PointCloud2, topic, qos.ROWS, take, triggers=False, raw=True)
        node.create_timer(_DISCOVERY_PERIOD, self._discover_machines)
        self._discover_machines()

    def send(self, messages: Iterable[Message], stamp: Time) -> None:
        """Publish messages of the soil; rows are stamped with the end of their tick."""
        for message in messages:
            if isinstance(message, RowChunk):
                publisher = self._rows_publisher(message)
                if publisher is not None:
                    publisher.publish(chunk_to_cdr(message, MAP_FRAME, stamp, self._key))
            elif isinstance(message, (Keyframe, KeyframeDue)):
                self._send_terrain()
            elif isinstance(message, JoinRejected):
                self._rejections.publish(to_join_rejected_string(message, self._key))
            else:
                self._tick.publish(message_to_cdr(message, self._key))

    def _rows_publisher(self, chunk: RowChunk) -> Publisher | None:
        """Return the publisher of rows; None for the backlog of a machine that was replaced."""
        if chunk.stream is Stream.BACKLOG:
            namespace = self.machines.get(chunk.machine_id)
            return None if namespace is None else self._backlog_publishers[namespace]
        return self._rows[chunk.stream]

    def _discover_machines(self) -> None:
        """Subscribe to machine nodes that have appeared."""
        for topic, _ in self._node.get_topic_names_and_types():
            namespace = machine_node_namespace(topic, self._node.get_namespace())
            if namespace is not None and namespace not in self._backlog_publishers:
                self._subscribe_to_machine(namespace)

    def _subscribe_to_machine(self, namespace: str) -> None:
        topic = resolve(topics.MACHINE_TICK, namespace)
        backlog = resolve(topics.CONVERSION_BACKLOG, namespace)
        self._backlog_publishers[namespace] = self._node.create_publisher(
            PointCloud2, backlog, qos.ROWS
        )
        take = partial(self._take_header, topic, namespace)
        self._poller.subscribe(Int64MultiArray, topic, qos.ROWS, take, raw=True)

    def _take_rows(self, topic: str, stream: Stream, data: bytes) -> None:
        self._take(topic, lambda: decode_chunk(data, stream, self._key))

    def _take_header(self, topic: str, namespace: str, data: bytes) -> None:
        self._take(topic, lambda: self._decode_machine_message(namespace, data))

    def _decode_machine_message(self, namespace: str, data: bytes) -> Message:
        message = decode_array(data, self._key)
        if not isinstance(message, (MachineHeader, RetransmitRequest)):
            raise ExchangeError(
                f"a {type(message).__name__} does not come from a machine node",
                ErrorCode.STREAM_DIRECTION,
            )
        is_request = isinstance(message, MachineHeader) and message.verb in (Verb.JOIN, Verb.REJOIN)
        reason = self._find_conflict(message.machine_id, namespace, is_request=is_request)
        if reason:
            if is_request:
                rejection = JoinRejected(
                    message.run_id, message.machine_id, message.session_id, reason
                )
                self._rejections.publish(to_join_rejected_string(rejection, self._key))
            raise ExchangeError(reason, ErrorCode.MACHINE_ID_TAKEN)
        others = self._other_ids(message.machine_id, namespace)
        if is_request:  # a node that replaces the one before
            for other in others:
                del self.machines[other]
        if is_request or not others:
            self.machines[message.machine_id] = namespace
        return message

    def _find_conflict(self, machine_id: int, namespace: str, *, is_request: bool) -> str:
        """Return why a machine node conflicts with another one that is there; empty if not.

        Args:
            machine_id: machine id of its message.
            namespace: its namespace.
            is_request: whether it requests to join.
        """
        owner = self.machines.get(machine_id, namespace)
        if owner != namespace and self._node.count_publishers(resolve(topics.MACHINE_TICK, owner)):
            return (
                f"machine_id {machine_id} belongs to {owner}; give {namespace} another `machine_id`"
            )
        others = self._other_ids(machine_id, namespace)
        topic = resolve(topics.MACHINE_TICK, namespace)
        if is_request and others and self._node.count_publishers(topic) > 1:
            return (
                f"{namespace} is the namespace of the machine node with machine_id {others[0]};"
                f" start the node with machine_id {machine_id} in another namespace"
            )
        return ""

    def _other_ids(self, machine_id: int, namespace: str) -> list[int]:
        """Return the machine ids other than `machine_id` of a namespace."""
        return [n for n, each in self.machines.items() if each == namespace and n != machine_id]

    def _take(self, topic: str, decode: Callable[[], Any]) -> None:
        try:
            message = decode()
            if self._receive(message):
                self.last_message_times[message.machine_id] = time.monotonic()
        except ExchangeError as error:
            self._reject(topic, error.coded_message)
