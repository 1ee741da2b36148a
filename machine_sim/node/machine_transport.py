"""Transport of a machine node's exchange over topics; the messages are those of the direct one."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Int64MultiArray, String

from msg_bridge.codec import qos
from msg_bridge.codec.exchange_key import ExchangeKey
from msg_bridge.codec.row_chunks import chunk_to_cdr
from msg_bridge.codec.tick_headers import from_join_rejected_string, message_to_cdr
from msg_bridge.contract import topics
from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.messages import Message, RetransmitRequest, RowChunk, SoilHeader, Stream
from msg_bridge.contract.topics import (
    MAP_FRAME,
    STREAM_TOPICS,
    parent_namespace,
    resolve,
)
from msg_bridge.nodes.map_decoder import MapDecoder
from msg_bridge.nodes.message_decoding import decode_array, decode_chunk
from msg_bridge.nodes.subscription_poller import SubscriptionPoller

__all__ = ["MachineTransport"]

_SENT_STREAMS = (Stream.SWEEP, Stream.DEPOSIT_REQUEST)
_RECEIVED_STREAMS = (Stream.CONVERSION, Stream.MAP_UPDATE, Stream.FORCE)


class MachineTransport:
    """Topics of the exchange of a machine node.

    Attributes:
        maps: decoder of terrain maps; it needs the cell size of the run.
        tick_topic: name of the topic of the soil's headers.
    """

    def __init__(
        self,
        node: Node,
        poller: SubscriptionPoller,
        receive: Callable[[Message], None],
        reject: Callable[[str, str], None],
        exchange_key_file: str = "",
    ) -> None:
        """
        Args:
            node: node of the topics; `soil_tick` and `conversion_backlog` are in its namespace.
            poller: poller of the node for messages of the soil.
            receive: called with each message; it may raise ExchangeError.
            reject: called with topic and reason of an invalid message.
            exchange_key_file: file of the key that authenticates all messages but the terrain;
                empty: they are not authenticated.

        Raises:
            ParameterError: the key file cannot be used.
        """
        self._receive = receive
        self._reject = reject
        self._key = key = ExchangeKey.read(exchange_key_file)
        self.maps = MapDecoder(
            lambda keyframe: self._receive(keyframe),
            reject,
            simulation_namespace=parent_namespace(node.get_namespace()),
        )
        simulation = parent_namespace(node.get_namespace())
        self._tick = node.create_publisher(Int64MultiArray, topics.MACHINE_TICK, qos.ROWS)
        self._rows = {
            stream: node.create_publisher(
                PointCloud2, resolve(STREAM_TOPICS[stream], simulation), qos.ROWS
            )
            for stream in _SENT_STREAMS
        }

        def subscribe(
            kind: Any,
            topic: str,
            profile: Any,
            decode: Callable[[Any], Message],
            *,
            triggers: bool = True,
            raw: bool = True,
        ) -> None:
            take = partial(self._on_message, topic, decode)
            poller.subscribe(kind, topic, profile, take, triggers=triggers, raw=raw)

        self.tick_topic = resolve(topics.SOIL_TICK, simulation)
        subscribe(
            Int64MultiArray, self.tick_topic, qos.ROWS, partial(_decode_soil_message, key=key)
        )
        for stream in _RECEIVED_STREAMS:
            decode = partial(decode_chunk, stream=stream, key=key)
            # The header follows the rows that it counts.
            subscribe(
                PointCloud2,
                resolve(STREAM_TOPICS[stream], simulation),
                qos.ROWS,
                decode,
                triggers=False,
            )
        backlog = partial(decode_chunk, stream=Stream.BACKLOG, key=key)
        subscribe(PointCloud2, topics.CONVERSION_BACKLOG, qos.ROWS, backlog)
        subscribe(
            String,
            resolve(topics.SOIL_JOIN_REJECTIONS, simulation),
            qos.ROWS,
            partial(from_join_rejected_string, key=key),
            raw=False,
        )
        self._poller, self._follows_maps = poller, False
        self.follow_maps(True)

    def follow_maps(self, is_wanted: bool) -> None:
        """Begin to receive terrain maps, with the last one, or end that."""
        if is_wanted and not self._follows_maps:
            self.maps.subscribe(self._poller)
        elif self._follows_maps and not is_wanted:
            self.maps.unsubscribe(self._poller)
        elif is_wanted:
            self.maps.check(self._poller)
        self._follows_maps = is_wanted

    def send(self, messages: Iterable[Message], stamp: Time) -> None:
        """Publish messages of the machine; rows are stamped with the end of their tick."""
        for message in messages:
            if isinstance(message, RowChunk):
                self._rows[message.stream].publish(
                    chunk_to_cdr(message, MAP_FRAME, stamp, self._key)
                )
            else:
                self._tick.publish(message_to_cdr(message, self._key))  # type: ignore[arg-type]

    def _on_message(self, topic: str, decode: Callable[[Any], Message], msg: Any) -> None:
        try:
            self._receive(decode(msg))
        except ExchangeError as error:
            self._reject(topic, error.coded_message)


def _decode_soil_message(data: bytes, key: ExchangeKey | None) -> Message:
    message = decode_array(data, key)
    if not isinstance(message, (SoilHeader, RetransmitRequest)):
        raise ExchangeError(
            f"a {type(message).__name__} is not a message of the soil to machines",
            ErrorCode.STREAM_DIRECTION,
        )
    return message
