"""Node that records all topics into a bag and publishes its status.

python -m msg_bridge.recorder.recorder_node --ros-args -p path:=bags/dig -p exclude:=/camera/
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo
from std_msgs.msg import String

from msg_bridge.bag.bundled_types import GRID_MAP_TYPE, TF_TYPE
from msg_bridge.bag.metadata import OfferedQos
from msg_bridge.bag.terrain_deltas import CLOUD_TYPE
from msg_bridge.bag.writer import BagWriter
from msg_bridge.codec import qos
from msg_bridge.codec.stamps import clock_time_ns
from msg_bridge.contract import topics
from msg_bridge.nodes.diagnostics import Diagnostics
from msg_bridge.nodes.process_main import run_background_node
from msg_bridge.nodes.ros_parameters import declare_parameters, reject_unknown_overrides
from msg_bridge.nodes.wait_log import Wait, WaitLog
from msg_bridge.raw_topics.graph_topics import GraphTopics
from msg_bridge.raw_topics.grid_map_from_terrain import GRID_MAP_QOS, GridMapFromTerrain
from msg_bridge.raw_topics.map_from_tiles import MAP_QOS, MapFromTiles, is_tiles_topic
from msg_bridge.raw_topics.raw_subscriptions import (
    advertised_type_hash,
    all_transient_local,
    offered_qos,
)
from msg_bridge.raw_topics.received_message import ReceivedMessage
from msg_bridge.raw_topics.tf_from_transforms import TF_QOS, TfFromTransforms
from msg_bridge.recorder.background_writer import BackgroundWriter
from msg_bridge.recorder.params import RecorderParams
from msg_bridge.recorder.recording import BagRecording
from msg_bridge.recorder.usage import USAGE

__all__ = ["RecorderNode", "main"]

# Wall times [s].
_POLL_PERIOD = 0.02
_REPORT_PERIOD = 1.0
_TERMINAL_PERIOD = 0.5  # of progress on a terminal
_LOG_PERIOD = 5.0  # of progress in a log
_MAX_DRAIN_TIME = 1.0

_MIN_REPORTED_QUEUE = 1 << 24
"""Size of the queue at the end from which on it is reported that it is written [bytes]."""

_MAX_MESSAGES_BEFORE_CLOCK = 10_000
"""Maximum number of messages kept until the first /clock; then simulation time 0 is assumed."""


class RecorderNode(Node):
    """Node `exchange_recorder`; records until it is stopped.

    Attributes:
        recording: the bag and its statistics.
        diagnostics: its entry on `/diagnostics`.
    """

    def __init__(self, **kwargs: Any) -> None:
        """Create the bag and subscribe to the topics of the graph.

        Args:
            kwargs: of `rclpy.node.Node`.

        Raises:
            ParameterError: a parameter is not valid.
            BagError: the bag cannot be written.
        """
        super().__init__("exchange_recorder", **kwargs)
        params = self._params = declare_parameters(self, RecorderParams)
        reject_unknown_overrides(self)  # before there is a bag
        writer = BagWriter(
            params.folder, compression=params.compression, chunk_size=params.chunk_size
        )
        self.recording = BagRecording(BackgroundWriter(writer, params.max_queue_size), params)
        self._clock_topic = self.resolve_topic_name(topics.CLOCK)
        self._uses_sim_time = bool(self.get_parameter("use_sim_time").value)
        self._graph_topics = GraphTopics(
            self, self, is_selected=lambda topic: self._is_recorded(topic) or self._is_source(topic)
        )
        self._tf = TfFromTransforms(self._graph_topics)
        self._maps = MapFromTiles()
        self._grid_map = GridMapFromTerrain(self._graph_topics, params.grid_map_period)
        self._stopped = False
        self._sim_time: int | None = None  # ns
        self._messages_before_clock: list[ReceivedMessage] = []
        self._is_terminal = params.progress and sys.stdout.isatty()
        self._status = self.create_publisher(String, topics.RECORDER_STATUS, qos.TRANSIENT_LOCAL)
        self.diagnostics = Diagnostics(self, simulation_namespace=self.get_namespace())
        self.diagnostics.add_task(self._update_diagnostics)
        WaitLog(self, self.diagnostics, self._find_waits)
        self._start_timers()
        self.get_logger().info(f"recording into {self.recording.path}")
        self._graph_topics.scan()

    def stop(self) -> None:
        """Write the queued messages and finish the bag; a second call does nothing.

        Raises:
            BagError: the bag cannot be written. It is not raised again after an earlier one; what
                was written before can be read.
        """
        if self._stopped:
            return
        self._stopped = True
        if not self.recording.has_failed:
            deadline = time.monotonic() + _MAX_DRAIN_TIME
            while self._poll() and time.monotonic() < deadline:
                pass
            self._write_messages_before_clock(0)
            self._graph_topics.check_publishers(resubscribe=False)
            waiting = self.recording.status()["bytes_queued"]
            if waiting > _MIN_REPORTED_QUEUE:
                self._end_line()
                self.get_logger().info(f"the disk is slow: writing the last {waiting / 1e6:.0f} MB")
        self.recording.close()
        if not self.recording.has_failed:
            self._end_line()
            print(self.recording.summary(), flush=True)

    def _start_timers(self) -> None:
        periods = [
            (_POLL_PERIOD, self._poll),
            (self._params.scan_period, self._graph_topics.scan),
            (self._params.flush_period, self.recording.flush),
            (_REPORT_PERIOD, self._publish_status),
        ]
        if self._params.progress:
            periods.append(
                (_TERMINAL_PERIOD if self._is_terminal else _LOG_PERIOD, self._print_progress)
            )
        # Timers of the node's own clock would stop with the simulation time.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        for period, callback in periods:
            self.create_timer(period, callback, clock=steady)

    # Topics, as GraphTopics finds them.

    def add_topic(
        self, topic: str, type_name: str, publishers: Sequence[TopicEndpointInfo]
    ) -> None:
        """Add a topic to the bag, unless it is subscribed only as the source of simulation time."""
        if self._is_recorded(topic) and topic not in self.recording.topics:
            self.recording.add_topic(
                topic,
                type_name,
                [offered_qos(each) for each in publishers],
                advertised_type_hash(publishers[0]),
            )

    def update_publishers(self, topic: str, publishers: Sequence[TopicEndpointInfo]) -> None:
        """Update the publishers of a recorded topic."""
        if self._is_recorded(topic):
            identities = frozenset(bytes(each.endpoint_gid) for each in publishers)
            transient_local = bool(publishers) and all_transient_local(publishers)
            self.recording.update_publishers(topic, identities, transient_local=transient_local)

    def before_resubscription(self) -> None:
        """Write the queued messages."""
        self._poll()

    def warn(self, text: str) -> None:
        """Log a warning below the progress line."""
        self._end_line()
        self.get_logger().warning(text)

    def _is_recorded(self, topic: str) -> bool:
        """Return whether a topic is recorded; of tiles, the maps that are made from them."""
        return self._params.is_selected(topic) and not is_tiles_topic(topic)

    def _is_source(self, topic: str) -> bool:
        """Return whether a topic is received but not recorded as it is."""
        return self._is_clock(topic) or is_tiles_topic(topic)

    def _is_clock(self, topic: str) -> bool:
        """Return whether the topic is the source of simulation time."""
        return self._uses_sim_time and topic == self._clock_topic

    # Recording.

    def _poll(self) -> int:
        """Write all queued messages; return their number."""
        messages = self._graph_topics.take()
        for message in messages:
            if not is_tiles_topic(message.topic):
                self._write(message)
        for message in self._maps.convert(messages):
            self._write_made(message, CLOUD_TYPE, MAP_QOS)
        for message in self._tf.convert(messages) if self._params.make_tf else ():
            self._write_made(message, TF_TYPE, TF_QOS)
        for message in self._grid_map.convert(messages) if self._params.grid_map_period else ():
            self._write_made(message, GRID_MAP_TYPE, GRID_MAP_QOS)
        now = self._sim_time if self._uses_sim_time else time.time_ns()
        if now is not None and not self._stopped:
            self.recording.repeat_transient_local(now)
        return len(messages)

    def _write(self, message: ReceivedMessage) -> None:
        """Write a message with its time of reception as log time.

        With simulation time, that is the last /clock received before the message. The node's own
        clock may be ahead of it when the message is polled.
        """
        if not self._uses_sim_time:
            self.recording.write(message, message.received_time)
            return
        if self._is_clock(message.topic):
            time = clock_time_ns(message.data)
            if time is not None:
                self._sim_time = time
                self._write_messages_before_clock(time)
            if not self._is_recorded(message.topic):
                return
        if self._sim_time is not None:
            self.recording.write(message, self._sim_time)
            return
        self._messages_before_clock.append(message)
        if len(self._messages_before_clock) == _MAX_MESSAGES_BEFORE_CLOCK:
            self._sim_time = 0
            self._write_messages_before_clock(0)

    def _write_made(self, message: ReceivedMessage, type_name: str, offered: OfferedQos) -> None:
        """Write a message that was made from others, unless its topic is not selected."""
        if not self._is_recorded(message.topic):
            return
        if message.topic not in self.recording.topics:
            self.recording.add_topic(message.topic, type_name, [offered], None)
            if offered.durability == "transient_local":
                made = frozenset([message.topic.encode()])
                self.recording.update_publishers(message.topic, made, transient_local=True)
        self._write(message)

    def _write_messages_before_clock(self, log_time: int) -> None:
        """Write the messages received before the first /clock."""
        early, self._messages_before_clock = self._messages_before_clock, []
        for message in early:
            self.recording.write(message, log_time)

    # Reporting.

    def _publish_status(self) -> None:
        """Publish the status."""
        self._status.publish(String(data=json.dumps(self.recording.status())))

    def _find_waits(self) -> list[Wait]:
        """Return what the recorder waits for: with simulation time, the first /clock."""
        if not self._uses_sim_time or self._sim_time is not None:
            return []
        return [
            Wait(
                f"the first message on {self._clock_topic}",
                "messages are kept until then: start a soil_sim, or record without use_sim_time",
            )
        ]

    def _update_diagnostics(self) -> None:
        status = self.recording.status()
        for key in (
            "path",
            "topics",
            "messages",
            "bytes",
            "bytes_on_disk",
            "bytes_queued",
            "files",
            "num_lost",
            "input_files",
        ):
            self.diagnostics.set(key, status[key])
        problems = [self.recording.loss_text()] if status["num_lost"] else []
        problems += filter(None, [self.recording.missing_files_text()])
        if problems:
            self.diagnostics.problem("; ".join(problems))
        else:
            self.diagnostics.clear()

    def _print_progress(self) -> None:
        if self._is_terminal:
            print(f"\r{self.recording.progress()}\x1b[K", end="", flush=True)
        else:
            self.get_logger().info(self.recording.progress())

    def _end_line(self) -> None:
        """End the progress line, so that the next print does not overwrite it."""
        if self._is_terminal:
            print(f"\r{self.recording.progress()}\x1b[K", flush=True)


def main(args: Sequence[str] | None = None) -> int:
    """Run the recorder as a process until SIGINT or SIGTERM.

    Args:
        args: command line with the program name first; by default `sys.argv`.

    Returns:
        The exit code: 0, or 2 with a message on stderr.
    """
    return run_background_node(RecorderNode, args, name="exchange_recorder", usage=USAGE)


if __name__ == "__main__":
    sys.exit(main())
