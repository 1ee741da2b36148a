"""Publish a large terrain as tiles, a few at a time, so that no tick is late.

A full round is sent for a new subscriber, for a machine that joins, and now and then, for those
that lost a tile; in between, the tiles that changed. See `msg_bridge.codec.terrain_tiles`.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

from builtin_interfaces.msg import Time
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from msg_bridge.codec import qos
from msg_bridge.codec.terrain import TerrainMap
from msg_bridge.codec.terrain_tiles import (
    TERRAIN_TILE,
    TILE_SIZE,
    TileOutline,
    TileRound,
    tile_to_cdr,
)
from msg_bridge.contract import topics
from msg_bridge.contract.rows import Rows
from msg_bridge.contract.topics import MAP_FRAME
from soil_sim.node.published_cells import PublishedCells
from soil_sim.node.soil_run import SoilRun

__all__ = ["TilePublication"]

_SEND_PERIOD = 0.01
"""Wall time between two calls that send tiles [s]."""

_TILES_PER_CALL = 4
"""Number of tiles that a call sends while there are no ticks; else one, so that no tick is late.
Subscribers must keep up: what they cannot take for a while waits in a queue of `qos.TILES`."""

_STANDSTILL_TIME = 0.1
"""Wall time without a tick after which there are none [s]."""

_MAX_WAITS = 4
"""Number of calls for which all tiles are withheld until a new subscriber is matched."""

_TILE_BYTES = TILE_SIZE**2 * TERRAIN_TILE.itemsize
"""Size of the points of a tile."""

_CALLS_WHILE_LATE = 2
"""Number of calls for each tile while ticks are late."""

_FULL_ROUND_TIME = 30.0
"""Simulated time after which changed terrain is sent in full again [s]."""


class TilePublication:
    """Publishes the terrain of a run as tiles; `begin` comes before all else."""

    def __init__(self, node: Node, run: SoilRun, terrain: Callable[[], TerrainMap]) -> None:
        """
        Args:
            node: the soil node.
            run: the run of the soil, which a reset begins again.
            terrain: returns the present terrain.
        """
        self._node, self._run, self._terrain = node, run, terrain
        self._publisher = node.create_publisher(PointCloud2, topics.TERRAIN_TILES, qos.TILES)
        self._subscriptions: set[bytes] = set()  # those that were sent a full round
        self._published: PublishedCells
        self._queue: deque[TileOutline] = deque()  # tiles of the present round
        self._round = TileRound(0, 0, 0, 0, 0, 0)
        self._stamp = self._round_stamp = Time()
        self._is_full_due = self._is_changed_due = False
        self._next_full_tick = self._num_calls = 0
        self._last_tick_time = 0.0  # monotonic clock [s]
        self._num_waits = 0  # for a new subscriber to be matched
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(_SEND_PERIOD, self._send, clock=steady)
        self._timer.cancel()

    def begin(self, stamp: Time) -> None:
        """Publish the terrain with which a run begins, or continues."""
        self._published = PublishedCells(self._terrain())
        self._queue.clear()
        self.send_all(stamp)

    def record_tick(self, map_updates: Rows, stamp: Time) -> None:
        """Note the changes of a tick.

        Args:
            map_updates: its MAP_UPDATE rows.
            stamp: its end.
        """
        cut_fill = self._run.cut_fill
        difference = None if cut_fill is None else cut_fill.difference
        material = self._run.endpoint.soil.columns.material
        self._published.update(map_updates, material, difference)
        self._stamp, self._last_tick_time = stamp, time.monotonic()

    def publish_if_changed(self, stamp: Time) -> None:
        """Publish the tiles that changed since the last round."""
        self._stamp = stamp
        if self._published.has_changed and self._publisher.get_subscription_count():
            self._is_changed_due = True
            self._start_sending()

    def send_all(self, stamp: Time) -> None:
        """Publish all tiles, of the present terrain."""
        self._stamp = stamp
        self._is_full_due = True
        self._start_sending()

    def update_for_new_subscribers(self, stamp: Time) -> None:
        """Publish all tiles if there is a new subscriber; call it a few times a second.

        One that is in the ROS graph may not be matched yet. Some never are, as those that request
        another QoS: others do not wait for them.
        """
        infos = self._node.get_subscriptions_info_by_topic(self._publisher.topic_name)
        found = {bytes(info.endpoint_gid) for info in infos}
        if found <= self._subscriptions:
            self._subscriptions, self._num_waits = found, 0
            return
        self._num_waits += 1
        is_matched = self._publisher.get_subscription_count() >= len(found)
        if is_matched or self._num_waits > _MAX_WAITS:
            self._subscriptions, self._num_waits = found, 0
            self.send_all(stamp)

    def _start_sending(self) -> None:
        if self._timer.is_canceled():
            self._timer.reset()

    def _send(self) -> None:
        """Send a few tiles of the present round, or begin another one."""
        if not self._queue:
            self._begin_round()
        if not self._queue:
            self._timer.cancel()
        is_late = self._run.realtime and self._run.scheduler.is_due
        self._num_calls += 1
        if is_late and self._num_calls % _CALLS_WHILE_LATE:
            return
        has_ticks = time.monotonic() - self._last_tick_time < _STANDSTILL_TIME
        for _ in range(min(len(self._queue), 1 if has_ticks else _TILES_PER_CALL)):
            outline = self._queue.popleft()
            self._publisher.publish(
                tile_to_cdr(
                    self._published.cells, outline, self._round, MAP_FRAME, self._round_stamp
                )
            )
        if self._round.is_full and self._queue:
            # To send the tiles takes longer than their size alone explains.
            self._run.expect_keyframe(time.monotonic(), len(self._queue) * _TILE_BYTES)

    def _begin_round(self) -> None:
        """Begin the round that is wanted, if any."""
        published = self._published
        published.release()
        if not self._publisher.get_subscription_count():
            self._is_full_due = self._is_changed_due = False  # a new subscriber is sent all tiles
        tick = self._run.tick
        is_full = self._is_full_due or (self._is_changed_due and tick >= self._next_full_tick)
        if not is_full and not self._is_changed_due:
            return
        changed = published.take_changed_tiles()
        self._queue.extend(published.outlines if is_full else changed)
        self._is_full_due = self._is_changed_due = False
        if is_full:
            self._next_full_tick = tick + round(_FULL_ROUND_TIME / self._run.params.tick_period)
        published.hold()
        self._round = TileRound(
            self._run.endpoint.exchange.run_id,
            published.revision,
            published.revision if is_full else self._round.revision,
            len(self._queue),
            *published.cells.shape,
        )
        self._round_stamp = self._stamp
