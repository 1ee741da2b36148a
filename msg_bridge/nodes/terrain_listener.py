"""The terrain as any node can follow it: by the public topics, without taking part."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Int64MultiArray

from msg_bridge.codec import qos
from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import Message, Stream
from msg_bridge.exchange.follower import TerrainFollower
from msg_bridge.nodes.inbox import Inbox
from msg_bridge.nodes.map_reader import MapReader
from msg_bridge.nodes.topics import MAP_TOPIC, STREAM_TOPIC, TICK_TOPIC
from msg_bridge.nodes.wire import read_array, read_chunk

__all__ = ["TerrainListener"]

_STALLED = 0.5
"""Wall time without a new tick after which a keyframe is taken for what is missing [s]."""


class TerrainListener:
    """Subscriptions that keep a `TerrainFollower` up to date.

    Attributes:
        follower: grid, elevation and revision of the terrain, and the tick they are of.
        maps: to be told the side length of a column where it must be exact; see `MapReader`.
    """

    def __init__(
        self,
        node: Node,
        inbox: Inbox,
        refuse: Callable[[str, str], None],
        resynced: Callable[[], None],
    ) -> None:
        """
        Args:
            node: whose subscriptions they are.
            inbox: of the node, which must have something to wake it in every tick: the ledger,
                say, which is published last.
            resynced: called when a keyframe was taken while nothing came.
            refuse: told topic and reason of a message that cannot be taken.
        """
        self.follower = TerrainFollower()
        self._resynced, self._refuse = resynced, refuse
        self.maps = MapReader(self.follower.receive, refuse, guess=True)
        self._seen = -1

        def subscribe(
            kind: Any, topic: str, profile: Any, decode: Callable[[Any], Message], *, raw: bool
        ) -> None:
            take = partial(self._take, topic, decode)
            inbox.subscribe(kind, topic, profile, take, wakes=False, raw=raw)

        changes, rows = STREAM_TOPIC[Stream.CHANGED], partial(read_chunk, stream=Stream.CHANGED)
        inbox.subscribe(PointCloud2, MAP_TOPIC, qos.LATCHED, self.maps.read, wakes=False)
        subscribe(PointCloud2, changes, qos.ROWS, rows, raw=True)
        subscribe(Int64MultiArray, TICK_TOPIC, qos.ROWS, _soil_word, raw=True)
        # A timer of the node's own clock would stop with simulation time.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(_STALLED, self._on_stall, clock=steady)

    def _take(self, topic: str, decode: Callable[[Any], Any], msg: Any) -> None:
        try:
            self.follower.receive(decode(msg))
        except ExchangeError as error:
            self._refuse(topic, str(error))

    def _on_stall(self) -> None:
        stalled = self.follower.tick == self._seen
        self._seen = self.follower.tick
        if stalled and self.follower.resync():
            self._resynced()


def _soil_word(data: bytes) -> Message:
    message = read_array(data)
    if isinstance(message, Ledger):
        raise ExchangeError("a ledger is nothing the soil says here")
    return message
