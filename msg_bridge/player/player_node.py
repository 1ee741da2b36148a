"""Node that publishes the messages of a bag, with the QoS of the recorded publishers."""

from __future__ import annotations

import json
import math
import sys
import time
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64, String
from std_srvs.srv import SetBool, Trigger

from msg_bridge.bag.message_schemas import SchemaError
from msg_bridge.bag.metadata import OfferedQos
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec import qos
from msg_bridge.codec.stamps import stamp_from_nanoseconds
from msg_bridge.contract import topics
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.interface import is_exclusive
from msg_bridge.count_text import count_text
from msg_bridge.player.keys import Key, KeyReader
from msg_bridge.player.map_updates import find_map_updates
from msg_bridge.player.params import MAX_RATE, MIN_RATE, PlayerParams
from msg_bridge.player.playback import Playback
from msg_bridge.raw_topics.raw_subscriptions import message_class

__all__ = ["PlayError", "PlayerNode"]

_NAME = "bag_player"

# Wall times [s].
_POLL_PERIOD = 0.005
_STATUS_PERIOD = 0.5
_DISCOVERY_TIME = 1.0
"""Time for which the node waits before the first message, until subscribers have found it."""
_CLOCK_PERIOD = 0.01
_KEY_SEEK = 10.0
_KEY_RATE = 2.0

_MAX_BATCH = 500
"""Maximum number of messages between two looks at the clock."""
_MAX_WARNINGS = 10
"""Maximum number of damaged messages with a warning of their own; all are counted."""
_DEPTH = 1000
_MAP, _UPDATES = f"/{topics.TERRAIN_MAP}", f"/{topics.TERRAIN_MAP_UPDATES}"
_CLOCK = f"/{topics.CLOCK}"
_STATIC_TF = "/tf_static"


class PlayError(EarthmovingError):
    """A bag cannot be played here."""


class PlayerNode(Node):
    """Node `bag_player`.

    Attributes:
        finished: whether everything has been published; the process ends.
        skipped: type of each topic that is not played because the type is not installed.
        damaged: numbers of the messages that could not be published.
        playback: the position in the bag.
    """

    def __init__(
        self, path: Path, params: PlayerParams, keys: KeyReader | None = None, **kwargs: Any
    ) -> None:
        """Index the bag and create the publishers; playing begins a second later.

        Args:
            path: folder of the bag, or a file.
            params: what is played, and how.
            keys: keys that control it.
            kwargs: of `rclpy.node.Node`.

        Raises:
            BagReadError: the bag cannot be read.
            PlayError: nothing is to be played, or playing begins after the end of the bag.
        """
        super().__init__(_NAME, **kwargs)
        self._params, self._keys = params, keys
        self._path = path
        reader = BagReader(path)
        selected = [topic for topic in reader.topics if self._is_played(topic)]
        self.skipped: dict[str, str] = {}
        self._by_topic: dict[str, Publisher] = {}
        self._transient_local: set[str] = set()
        for topic in selected:
            self._add_publisher(reader, topic)
        self._index = reader.index(self._by_topic)
        if not self._index.size:
            raise PlayError(
                f"{path} has no message to play; its topics are {', '.join(reader.topics)}"
            )
        self.playback = self._playback(params)
        if params.start > self.playback.duration:
            raise PlayError(
                f"--start {params.start:g}: {path} has 0 to {self.playback.duration:.2f} s"
            )
        self.finished = False
        self._num_published = 0
        self.damaged: set[int] = set()
        self._last_published: dict[str, bytes] = {}  # of transient-local topics
        self._clock_publisher = self._make_clock_publisher(reader)
        self._last_clock = 0.0
        self._begin_time: float | None = time.monotonic() + _DISCOVERY_TIME
        self._create_control()

    def stop(self) -> None:
        """Close the bag, and report how many of its messages are damaged."""
        self._index.close()
        if self.damaged:
            count = count_text(len(self.damaged), "damaged message")
            self.get_logger().warning(f"{self._path}: {count} not published")

    @property
    def num_topics(self) -> int:
        """Number of topics that are played."""
        return len(self._by_topic)

    @property
    def num_messages(self) -> int:
        """Number of messages in the bag that are played."""
        return self._index.size

    def _is_played(self, topic: str) -> bool:
        """Return whether a topic is selected; state of recorder and player only by name."""
        if topic == _CLOCK and self._params.clock != "auto":
            return False
        is_own = topic.endswith(f"/{topics.RECORDER_STATUS}") or topic == f"/{_NAME}/status"
        return self._params.is_selected(topic) and bool(self._params.include or not is_own)

    def _add_publisher(self, reader: BagReader, topic: str) -> None:
        kind = reader.topics[topic].type
        try:
            message_type = message_class(kind)
        except SchemaError:
            self.skipped[topic] = kind
            return
        offered = reader.offered_qos(topic)
        is_transient_local = topic == _STATIC_TF or any(
            each.durability == "transient_local" for each in offered
        )
        if is_transient_local:
            self._transient_local.add(topic)
        self._by_topic[topic] = self.create_publisher(
            message_type,
            self._params.published_name(topic),
            _profile(offered, is_transient_local=is_transient_local),
        )

    def _playback(self, params: PlayerParams) -> Playback:
        return Playback(
            self._index,
            keyframe_topics=self._transient_local,
            find_updates=self._find_updates,
            start=params.start,
            end=params.end,
            rate=params.rate,
            is_looping=params.loop,
            is_paused=params.paused,
        )

    def _find_updates(self, topic: str, number: int, end: int) -> list[int]:
        """Return the messages with the updates that a keyframe lacks; see `Playback`."""
        if not topic.endswith(_MAP):
            return []
        return find_map_updates(self._index, topic.removesuffix(_MAP) + _UPDATES, number, end)

    def _make_clock_publisher(self, reader: BagReader) -> Publisher | None:
        """Return the publisher of log times as /clock; None if there is none."""
        mode = self._params.clock
        is_missing = _CLOCK not in reader.topics and self._params.is_selected(_CLOCK)
        if mode == "log" or (mode == "auto" and is_missing):
            return self.create_publisher(Clock, self._params.published_name(_CLOCK), qos.STATE)
        return None

    def _create_control(self) -> None:
        self._status = self.create_publisher(String, "~/status", qos.TRANSIENT_LOCAL)
        self.create_service(SetBool, "~/pause", self._on_pause)
        self.create_service(Trigger, "~/step", self._on_step)
        self.create_subscription(Float64, "~/seek", lambda msg: self.seek(msg.data), 10)
        self.create_subscription(Float64, "~/rate", lambda msg: self.set_rate(msg.data), 10)
        self.create_timer(_POLL_PERIOD, self._poll)
        self.create_timer(_STATUS_PERIOD, self._publish_status)

    # Control.

    def pause(self, paused: bool) -> None:
        """Pause or continue."""
        self.playback.is_paused = paused
        self._publish_status()

    def step(self) -> None:
        """Publish the next message and pause."""
        self.playback.is_paused = True
        self._publish(self.playback.take_next())
        self._publish_status()

    def seek(self, position: float) -> None:
        """Go to a position [s from the first message]; one that is not finite is ignored."""
        if math.isfinite(position):
            self.playback.seek(position)
            self._publish_status()

    def set_rate(self, rate: float) -> None:
        """Set the seconds of the bag per second; a rate that is not possible is ignored."""
        if MIN_RATE <= rate <= MAX_RATE:
            self.playback.rate = rate
            self._publish_status()
        else:
            self.get_logger().warning(f"rate {rate:g}: give {MIN_RATE:g} to {MAX_RATE:g}")

    def _on_pause(self, request: Any, response: Any) -> Any:
        self.pause(bool(request.data))
        response.success = True
        return response

    def _on_step(self, request: Any, response: Any) -> Any:
        self.step()
        response.success = True
        return response

    def _on_key(self, key: Key) -> None:
        if key is Key.PAUSE:
            self.pause(not self.playback.is_paused)
        elif key is Key.STEP:
            self.step()
        elif key is Key.QUIT:
            self.finished = True
        elif key in (Key.BACK, Key.FORWARD):
            sign = 1.0 if key is Key.FORWARD else -1.0
            self.seek(self.playback.position + sign * _KEY_SEEK)
        else:
            factor = _KEY_RATE if key is Key.FASTER else 1.0 / _KEY_RATE
            self.set_rate(min(max(self.playback.rate * factor, MIN_RATE), MAX_RATE))

    # Playing.

    def _poll(self) -> None:
        for key in self._keys.read() if self._keys is not None else ():
            self._on_key(key)
        now = time.monotonic()
        if self._begin_time is not None:
            if now < self._begin_time:
                return
            self._begin_time = None
            self._check_other_publishers()
        self._publish(self.playback.take(now, _MAX_BATCH))
        if self._clock_publisher is not None and now - self._last_clock >= _CLOCK_PERIOD:
            self._last_clock = now
            self._publish_clock()
        if self.playback.is_finished and not self.finished:
            self.finished = True
            self._publish_status()

    def _publish_clock(self) -> None:
        if self._clock_publisher is not None and not self.playback.is_paused:
            self._clock_publisher.publish(
                Clock(clock=stamp_from_nanoseconds(self.playback.log_time))
            )

    def _publish(self, numbers: list[int]) -> None:
        if self.playback.has_sought:
            self.playback.has_sought = False
            self._last_published.clear()
        for number in numbers:
            topic = self._index.topics[self._index.topic_numbers[number]]
            data = self._index.read(number)
            if topic in self._transient_local:
                # The recorder repeats them, so that a bag can be read from the middle.
                if self._last_published.get(topic) == data:
                    continue
                self._last_published[topic] = data
            try:
                self._by_topic[topic].publish(data)
            except RuntimeError as error:  # rclpy's RCLError is one
                if not self.context.ok():
                    raise
                self._report_damaged(number, topic, error)
            else:
                self._num_published += 1

    def _report_damaged(self, number: int, topic: str, error: Exception) -> None:
        """Count a message that the middleware rejects, and warn of the first ones."""
        if number in self.damaged:  # in a former loop, or before a seek
            return
        self.damaged.add(number)
        if len(self.damaged) <= _MAX_WARNINGS:
            self.get_logger().warning(
                f"{self._path}, log time {self._index.times[number]} ns: a message on {topic} is"
                f" damaged and is not published: {error}"
            )

    def _check_other_publishers(self) -> None:
        """Check that no other node publishes what only one may publish.

        Raises:
            PlayError: one does.
        """
        found = []
        for topic, publisher in self._by_topic.items():
            name = self._params.published_name(topic)
            if is_exclusive(topic) and self.count_publishers(name) > 1:
                found.append(publisher.topic_name)
        if found:
            more = f" and {len(found) - 1} more" if len(found) > 1 else ""
            raise PlayError(
                f"another node publishes {found[0]}{more}, so that both would be mixed; stop it,"
                " play in another ROS_DOMAIN_ID, or give --prefix"
            )

    # Reporting.

    def status(self) -> dict[str, Any]:
        """Return the content of `~/status`."""
        playback = self.playback
        return {
            "path": str(self._path),
            "position": round(playback.position, 3),
            "duration": round(playback.duration, 3),
            "rate": playback.rate,
            "is_paused": playback.is_paused,
            "is_finished": self.finished,
            "messages": self._num_published,
            "damaged_messages": len(self.damaged),
            "time_behind": round(playback.time_behind, 3),
        }

    def progress(self) -> str:
        """Return a line on the position."""
        playback = self.playback
        state = "paused" if playback.is_paused else f"{playback.rate:g} x"
        behind = playback.time_behind
        late = f", {behind:.1f} s behind the rate" if behind >= 0.1 else ""
        return (
            f"  {playback.position:.1f} of {playback.duration:.1f} s, {state},"
            f" {count_text(self._num_published, 'message')}{late}"
        )

    def _publish_status(self) -> None:
        self._status.publish(String(data=json.dumps(self.status())))
        if self._keys is not None and self._keys.is_terminal:
            print(f"\r{self.progress()}\x1b[K", end="", file=sys.stderr, flush=True)


def _profile(offered: tuple[OfferedQos, ...], *, is_transient_local: bool) -> QoSProfile:
    """Return a profile that every subscriber of the recorded publishers accepts."""
    is_reliable = not offered or any(each.reliability != "best_effort" for each in offered)
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=1 if is_transient_local else _DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if is_reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=(
            DurabilityPolicy.TRANSIENT_LOCAL if is_transient_local else DurabilityPolicy.VOLATILE
        ),
    )
