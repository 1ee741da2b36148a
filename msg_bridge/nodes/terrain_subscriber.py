"""Follow the terrain by its public topics, without taking part in the exchange."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Int64MultiArray

from msg_bridge.codec import qos
from msg_bridge.contract import topics
from msg_bridge.contract.constants import MAX_MAP_CELLS
from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import Message, Stream
from msg_bridge.contract.topics import STREAM_TOPICS, resolve
from msg_bridge.exchange.terrain_follower import TerrainFollower
from msg_bridge.nodes.map_decoder import MapDecoder
from msg_bridge.nodes.message_decoding import decode_array, decode_chunk
from msg_bridge.nodes.subscription_poller import SubscriptionPoller

__all__ = ["TerrainSubscriber"]

_STALL_TIME = 0.5
"""Wall time without a new tick after which a keyframe is taken for what is missing [s]."""


class TerrainSubscriber:
    """Subscriptions that keep a `TerrainFollower` up to date.

    Attributes:
        follower: grid, elevation and revision of the terrain, with their tick.
        maps: decoder of the maps; set its cell size where it must be exact.
    """

    def __init__(
        self,
        node: Node,
        poller: SubscriptionPoller,
        reject: Callable[[str, str], None],
        on_resync: Callable[[], None],
        *,
        simulation_namespace: str,
    ) -> None:
        """
        Args:
            node: node of the subscriptions.
            poller: poller of the node. It must have a triggering subscription in every tick, for
                example the ledger, which is published last.
            reject: called with topic and reason of a message that cannot be used.
            on_resync: called when a keyframe was applied because no update arrived.
            simulation_namespace: namespace of the soil node.
        """
        self.follower = TerrainFollower()
        self._on_resync, self._reject = on_resync, reject
        self.maps = MapDecoder(
            self.follower.receive,
            reject,
            simulation_namespace=simulation_namespace,
            guess=True,
        )
        self._last_tick = -1
        self._is_other_run = False  # whether the last message is of another run

        def subscribe(
            kind: Any, topic: str, profile: Any, decode: Callable[[Any], Message], *, raw: bool
        ) -> None:
            take = partial(self._take, topic, decode)
            poller.subscribe(kind, topic, profile, take, triggers=False, raw=raw)

        changes, rows = (
            resolve(STREAM_TOPICS[Stream.MAP_UPDATE], simulation_namespace),
            partial(decode_chunk, stream=Stream.MAP_UPDATE),
        )
        self._poller, self._follows_maps = poller, True
        self.maps.subscribe(poller, triggers=False)
        subscribe(PointCloud2, changes, qos.ROWS, rows, raw=True)
        subscribe(
            Int64MultiArray,
            resolve(topics.SOIL_TICK, simulation_namespace),
            qos.ROWS,
            _decode_soil_message,
            raw=True,
        )
        # A timer of the node's own clock would stop with simulation time.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(_STALL_TIME, self._on_stall, clock=steady)

    def _take(self, topic: str, decode: Callable[[Any], Any], msg: Any) -> None:
        try:
            message = decode(msg)
            self._is_other_run = message.run_id != self.follower.run_id
            self.follower.receive(message)
        except ExchangeError as error:
            self._reject(topic, error.coded_message)

    def _on_stall(self) -> None:
        stalled = self.follower.tick == self._last_tick
        self._last_tick = self.follower.tick
        if stalled and self.follower.resync():
            self._on_resync()
        self._follow_tiles(is_missing=stalled and self.follower.is_missing_rows)

    def _follow_tiles(self, *, is_missing: bool) -> None:
        """Receive large terrain only while it is missing: that takes long. Small, always.

        Args:
            is_missing: whether rows are missing that a newer terrain contains.
        """
        grid = self.follower.grid
        is_large = grid is not None and grid.rows * grid.cols > MAX_MAP_CELLS
        is_wanted = is_missing or self._is_other_run or not is_large
        if is_wanted and not self._follows_maps:
            self.maps.subscribe(self._poller, triggers=False)
        elif self._follows_maps and not is_wanted:
            self.maps.unsubscribe(self._poller)
        elif is_wanted:
            self.maps.check(self._poller, is_missing=is_missing and is_large)
        self._follows_maps = is_wanted


def _decode_soil_message(data: bytes) -> Message:
    message = decode_array(data)
    if isinstance(message, Ledger):
        raise ExchangeError(
            "a ledger does not belong on the topic of tick headers", ErrorCode.STREAM_DIRECTION
        )
    return message
