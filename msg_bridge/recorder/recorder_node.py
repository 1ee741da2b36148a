"""Node that records all topics into a bag and publishes its status.

python -m msg_bridge.recorder.recorder_node --ros-args -p path:=bags/dig -p exclude:=/camera/
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Sequence
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo
from std_msgs.msg import String

from msg_bridge.bag.message_schemas import SchemaError
from msg_bridge.bag.writer import BagWriter
from msg_bridge.codec import qos
from msg_bridge.codec.cdr_primitives import LITTLE_ENDIAN, STAMP
from msg_bridge.contract import topics
from msg_bridge.nodes.diagnostics import Diagnostics
from msg_bridge.nodes.process_main import run_node
from msg_bridge.nodes.ros_parameters import declare_parameters
from msg_bridge.nodes.wait_log import Wait, WaitLog
from msg_bridge.recorder.params import RecorderParams
from msg_bridge.recorder.raw_subscriptions import (
    RawSubscriptions,
    advertised_type_hash,
    all_transient_local,
    offered_qos,
)
from msg_bridge.recorder.recording import BagRecording, RecordedMessage
from msg_bridge.recorder.usage import USAGE

__all__ = ["RecorderNode", "main"]

# Wall times [s].
_POLL_PERIOD = 0.02
_REPORT_PERIOD = 1.0
_TERMINAL_PERIOD = 0.5  # of progress on a terminal
_LOG_PERIOD = 5.0  # of progress in a log
_MAX_DRAIN_TIME = 1.0

_SCANS_PER_PUBLISHER_CHECK = 10
"""Publishers of known topics are queried less often: a query is slow, and they rarely change."""

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
        writer = BagWriter(
            params.folder, compression=params.compression, chunk_size=params.chunk_size
        )
        self.recording = BagRecording(writer, params.repeat_transient_local_period)
        self._raw_subscriptions = RawSubscriptions(self)
        self._skipped: set[str] = set()
        self._scans = 0
        self._stopped = False
        self._clock_topic = self.resolve_topic_name(topics.CLOCK)
        self._uses_sim_time = bool(self.get_parameter("use_sim_time").value)
        self._sim_time: int | None = None  # ns
        self._messages_before_clock: list[RecordedMessage] = []
        self._is_terminal = params.progress and sys.stdout.isatty()
        self._status = self.create_publisher(String, topics.RECORDER_STATUS, qos.TRANSIENT_LOCAL)
        self.diagnostics = Diagnostics(self, simulation_namespace=self.get_namespace())
        self.diagnostics.add_task(self._update_diagnostics)
        WaitLog(self, self.diagnostics, self._find_waits)
        self._start_timers()
        self.get_logger().info(f"recording into {self.recording.path}")
        self._scan()

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
            self._check_publishers()
        self.recording.close()
        if not self.recording.has_failed:
            self._end_line()
            print(self.recording.summary(), flush=True)

    def _start_timers(self) -> None:
        periods = [
            (_POLL_PERIOD, self._poll),
            (self._params.scan_period, self._scan),
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

    # Finding topics.

    def _scan(self) -> None:
        """Subscribe to new topics; now and then check the publishers of the others."""
        self._scans += 1
        if self._scans % _SCANS_PER_PUBLISHER_CHECK == 0:
            self._check_publishers()
        known = {*self._raw_subscriptions.topics, *self._skipped}
        for topic, _ in self.get_topic_names_and_types():
            if topic in known:
                continue
            if not (self._is_recorded(topic) or self._is_clock(topic)):
                self._skipped.add(topic)
            elif publishers := self.get_publishers_info_by_topic(topic):
                self._add_topic(topic, publishers)

    def _add_topic(self, topic: str, publishers: list[TopicEndpointInfo]) -> None:
        types = sorted({each.topic_type for each in publishers})
        if len(types) > 1:
            self._warn(f"{topic} has types {', '.join(types)}; only the first is recorded")
        try:
            self._raw_subscriptions.add(topic, types[0], publishers)
            if self._is_recorded(topic):
                self.recording.add_topic(
                    topic,
                    types[0],
                    [offered_qos(p) for p in publishers],
                    advertised_type_hash(publishers[0]),
                )
        except SchemaError as error:
            self._raw_subscriptions.drop(topic)
            self._skipped.add(topic)
            self._warn(f"{topic} is not recorded: {error}")
            return
        self._update_publishers(topic, publishers)

    def _check_publishers(self) -> None:
        """Update the publishers of each topic; subscribe again where some are not received."""
        for topic in self._raw_subscriptions.topics:
            publishers = self.get_publishers_info_by_topic(topic)
            if self._raw_subscriptions.qos_incompatible(topic, publishers) and not self._stopped:
                self._poll()
                self._raw_subscriptions.resubscribe(topic, publishers)
            self._update_publishers(topic, publishers)

    def _update_publishers(self, topic: str, publishers: list[TopicEndpointInfo]) -> None:
        if self._is_recorded(topic):
            identities = frozenset(bytes(each.endpoint_gid) for each in publishers)
            transient_local = bool(publishers) and all_transient_local(publishers)
            self.recording.update_publishers(topic, identities, transient_local=transient_local)

    def _is_recorded(self, topic: str) -> bool:
        return self._params.is_selected(topic)

    def _is_clock(self, topic: str) -> bool:
        """Return whether the topic is the source of simulation time."""
        return self._uses_sim_time and topic == self._clock_topic

    # Recording.

    def _poll(self) -> int:
        """Write all queued messages; return their number."""
        messages = self._raw_subscriptions.take()
        for message in messages:
            self._write(message)
        now = self._sim_time if self._uses_sim_time else time.time_ns()
        if now is not None and not self._stopped:
            self.recording.repeat_transient_local(now)
        return len(messages)

    def _write(self, message: RecordedMessage) -> None:
        """Write a message with its time of reception as log time.

        With simulation time, that is the last /clock received before the message. The node's own
        clock may be ahead of it when the message is polled.
        """
        if not self._uses_sim_time:
            self.recording.write(message, message.received_time)
            return
        if self._is_clock(message.topic):
            seconds, nanoseconds = STAMP.unpack_from(message.data, len(LITTLE_ENDIAN))
            self._sim_time = seconds * 10**9 + nanoseconds
            self._write_messages_before_clock(self._sim_time)
            if not self._is_recorded(message.topic):
                return
        if self._sim_time is not None:
            self.recording.write(message, self._sim_time)
            return
        self._messages_before_clock.append(message)
        if len(self._messages_before_clock) == _MAX_MESSAGES_BEFORE_CLOCK:
            self._sim_time = 0
            self._write_messages_before_clock(0)

    def _write_messages_before_clock(self, log_time: int) -> None:
        """Write the messages received before the first /clock."""
        early, self._messages_before_clock = self._messages_before_clock, []
        for message in early:
            self.recording.write(message, log_time)

    # Reporting.

    def _publish_status(self) -> None:
        """Publish the status, after all recorded messages are in the file."""
        self.recording.flush()
        self._status.publish(String(data=json.dumps(self.recording.status())))

    def _find_waits(self) -> list[Wait]:
        """Return what the recorder waits for: with simulation time, the first /clock."""
        if not self._uses_sim_time or self._sim_time is not None:
            return []
        return [
            Wait(
                f"the first message on {self._clock_topic}; messages are kept until then: start a"
                " soil_sim, or record without use_sim_time"
            )
        ]

    def _update_diagnostics(self) -> None:
        status = self.recording.status()
        for key in ("path", "topics", "messages", "bytes", "bytes_on_disk", "num_lost"):
            self.diagnostics.set(key, status[key])
        if status["num_lost"]:
            self.diagnostics.problem(self.recording.loss_text())
        else:
            self.diagnostics.clear()

    def _print_progress(self) -> None:
        if self._is_terminal:
            print(f"\r{self.recording.progress()}\x1b[K", end="", flush=True)
        else:
            self.get_logger().info(self.recording.progress())

    def _warn(self, text: str) -> None:
        self._end_line()
        self.get_logger().warning(text)

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
    return run_node(_create_node, args, name="exchange_recorder", usage=USAGE)


def _create_node() -> RecorderNode:
    """Create the node and lower the priority of the process, which has no other nodes."""
    node = RecorderNode()
    os.nice(int(node.get_parameter("niceness").value))
    return node


if __name__ == "__main__":
    sys.exit(main())
