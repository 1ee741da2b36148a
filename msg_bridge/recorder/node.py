"""The recorder's node: finds topics, listens to all of them, and says how it goes.

python -m msg_bridge.recorder.node --ros-args -p path:=bags/dig -p exclude:=/camera/
"""

from __future__ import annotations

import json
import os
import struct
import sys
import time
from collections.abc import Sequence
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.topic_endpoint_info import TopicEndpointInfo
from std_msgs.msg import String

from msg_bridge.bag.schemas import SchemaError
from msg_bridge.bag.writer import BagWriter
from msg_bridge.codec import qos
from msg_bridge.nodes.diagnostics import Diagnostics
from msg_bridge.nodes.parameters import declare_parameters
from msg_bridge.nodes.runtime import run_node
from msg_bridge.recorder.core import Heard, Recording
from msg_bridge.recorder.listening import Listener, all_latched, hash_of, offered_qos
from msg_bridge.recorder.params import RecorderParams

__all__ = ["Recorder", "main"]

# All wall time [s].
_POLL_PERIOD = 0.02
_REPORT_PERIOD = 1.0
_LINE_PERIOD = 0.5  # on a terminal
_LOG_PERIOD = 5.0  # elsewhere
_LONGEST_DRAIN = 1.0

_SCANS_TO_REVIEW = 10
"""Who publishes on known topics is costlier to learn, and changes less often."""

_MOST_EARLY = 10_000
"""Messages kept until the first /clock; then simulation time is taken to begin at 0."""

_CLOCK = struct.Struct("<iI")  # rosgraph_msgs/Clock, after the 4 bytes that begin every CDR


class Recorder(Node):
    """Records until it is stopped.

    Attributes:
        recording: the bag and its figures.
        diagnostics: what `/diagnostics` says of it.
    """

    def __init__(self, **kwargs: Any) -> None:
        """
        Args:
            kwargs: for `rclpy.node.Node`.

        Raises:
            ParameterError: a parameter is not good.
            BagError: the bag cannot be written where it is to be written.
        """
        super().__init__("recorder", **kwargs)
        params = self._params = declare_parameters(self, RecorderParams)
        writer = BagWriter(
            params.folder, compression=params.compression, chunk_size=params.chunk_size
        )
        self.recording = Recording(writer, params.latched_period)
        self._listener = Listener(self)
        self._skipped: set[str] = set()
        self._scans = 0
        self._stopped = False
        self._clock_topic = self.resolve_topic_name("/clock")
        self._simulated = bool(self.get_parameter("use_sim_time").value)
        self._simulation_time: int | None = None  # ns
        self._early: list[Heard] = []  # what came before the first /clock
        self._on_terminal = params.progress and sys.stdout.isatty()
        self._status = self.create_publisher(String, "/recorder/status", qos.LATCHED)
        self.diagnostics = Diagnostics(self)
        self.diagnostics.add_task(self._diagnose)
        self._start_timers()
        self.get_logger().info(f"recording into {self.recording.path}")
        self._scan()

    def stop(self) -> None:
        """Take what has arrived, and finish the bag; a second call does nothing.

        Raises:
            BagError: the bag cannot be written. If that was raised before, it is not again: what
                has been written stays, and can be read.
        """
        if self._stopped:
            return
        self._stopped = True
        if not self.recording.broken:
            deadline = time.monotonic() + _LONGEST_DRAIN
            while self._poll() and time.monotonic() < deadline:
                pass
            self._write_early(0)
            self._see_publishers()
        self.recording.close()
        if not self.recording.broken:
            self._end_line()
            print(self.recording.summary(), flush=True)

    def _start_timers(self) -> None:
        periods = [
            (_POLL_PERIOD, self._poll),
            (self._params.scan_period, self._scan),
            (_REPORT_PERIOD, self._report),
        ]
        if self._params.progress:
            periods.append((_LINE_PERIOD if self._on_terminal else _LOG_PERIOD, self._tell))
        # Timers of the node's own clock would stop with simulation time.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        for period, callback in periods:
            self.create_timer(period, callback, clock=steady)

    # Finding topics.

    def _scan(self) -> None:
        """Listen to topics that are new; now and then see who publishes on the others."""
        self._scans += 1
        if self._scans % _SCANS_TO_REVIEW == 0:
            self._see_publishers()
        known = {*self._listener.topics, *self._skipped}
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
            self._listener.add(topic, types[0], publishers)
            if self._is_recorded(topic):
                self.recording.add_topic(
                    topic, types[0], [offered_qos(p) for p in publishers], hash_of(publishers[0])
                )
        except SchemaError as error:
            self._listener.drop(topic)
            self._skipped.add(topic)
            self._warn(f"{topic} is not recorded: {error}")
            return
        self._note_publishers(topic, publishers)

    def _see_publishers(self) -> None:
        """Look who publishes on each topic now, and see that all are heard."""
        for topic in self._listener.topics:
            publishers = self.get_publishers_info_by_topic(topic)
            if self._listener.is_deaf(topic, publishers) and not self._stopped:
                self._poll()
                self._listener.listen_again(topic, publishers)
            self._note_publishers(topic, publishers)

    def _note_publishers(self, topic: str, publishers: list[TopicEndpointInfo]) -> None:
        if self._is_recorded(topic):
            identities = frozenset(bytes(each.endpoint_gid) for each in publishers)
            latched = bool(publishers) and all_latched(publishers)
            self.recording.see_publishers(topic, identities, latched=latched)

    def _is_recorded(self, topic: str) -> bool:
        return self._params.wants(topic)

    def _is_clock(self, topic: str) -> bool:
        """Whether it tells the simulation time to go by."""
        return self._simulated and topic == self._clock_topic

    # Recording.

    def _poll(self) -> int:
        """Write what has arrived; returns how many messages that were."""
        heard = self._listener.take()
        for each in heard:
            self._write(each)
        now = self._simulation_time if self._simulated else time.time_ns()
        if now is not None and not self._stopped:
            self.recording.repeat_latched(now)
        return len(heard)

    def _write(self, heard: Heard) -> None:
        """Write a message, at the time when it arrived.

        Of simulation time that is what /clock told last before it. The node's clock may be ahead
        of that when the message is looked at.
        """
        if not self._simulated:
            self.recording.write(heard, heard.arrived)
            return
        if self._is_clock(heard.topic):
            seconds, nanoseconds = _CLOCK.unpack_from(heard.data, 4)
            self._simulation_time = seconds * 10**9 + nanoseconds
            self._write_early(self._simulation_time)
            if not self._is_recorded(heard.topic):
                return
        if self._simulation_time is not None:
            self.recording.write(heard, self._simulation_time)
            return
        self._early.append(heard)
        if len(self._early) == _MOST_EARLY:
            self._simulation_time = 0
            self._write_early(0)

    def _write_early(self, log_time: int) -> None:
        """Write what came before there was a time, at the first one there is."""
        early, self._early = self._early, []
        for heard in early:
            self.recording.write(heard, log_time)

    # Telling.

    def _report(self) -> None:
        """Say what is recorded, when it is in the file."""
        self.recording.flush()
        self._status.publish(String(data=json.dumps(self.recording.status())))

    def _diagnose(self) -> None:
        status = self.recording.status()
        for key in ("path", "topics", "messages", "bytes", "gaps"):
            self.diagnostics.set(key, status[key])
        if status["gaps"]:
            self.diagnostics.problem(self.recording.gaps_text())
        else:
            self.diagnostics.clear()

    def _tell(self) -> None:
        if self._on_terminal:
            print(f"\r{self.recording.progress()}\x1b[K", end="", flush=True)
        else:
            self.get_logger().info(self.recording.progress())

    def _warn(self, text: str) -> None:
        self._end_line()
        self.get_logger().warning(text)

    def _end_line(self) -> None:
        """Let what follows not be written over."""
        if self._on_terminal:
            print(f"\r{self.recording.progress()}\x1b[K", flush=True)


def main(args: Sequence[str] | None = None) -> int:
    """Run the recorder as a process until SIGINT or SIGTERM.

    Args:
        args: the command line with the program's name first, `sys.argv` by default.

    Returns:
        The exit code: 0, or 2 with a sentence on stderr.
    """
    return run_node(_make, args)


def _make() -> Recorder:
    """A recorder with the process to itself, which may therefore yield to others."""
    node = Recorder()
    os.nice(int(node.get_parameter("nice").value))
    return node


if __name__ == "__main__":
    sys.exit(main())
