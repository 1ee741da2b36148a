"""Programs that disturb a simulation in real time, each in a process of its own.

    python -m benchmarks.disturbances slow_subscriber
    python -m benchmarks.disturbances command_flood /excavator_1
    python -m benchmarks.disturbances slow_disk bags/slow 10

- `slow_subscriber` subscribes reliably to the largest topics and takes 0.5 s for each message.
- `command_flood` publishes 10,000 commands a second to a machine: track speeds of zero.
- `slow_disk` is a recorder whose disk takes 2 s for every write, for some seconds.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence

from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Float64MultiArray

from msg_bridge.bag.atomic_file import AtomicFile
from msg_bridge.codec import qos
from msg_bridge.contract import topics
from msg_bridge.nodes.process_main import run_node
from msg_bridge.recorder.recorder_node import RecorderNode

__all__ = ["FLOOD_RATE", "MODULE", "main"]

MODULE = "benchmarks.disturbances"
FLOOD_RATE = 10_000.0
"""Commands per second."""
CALLBACK_TIME = 0.5
WRITE_TIME = 2.0
FLOOD_PERIOD = 0.002
"""Time between bursts of commands [s]."""
SLOW_TOPICS = (
    topics.TERRAIN_MAP_UPDATES,
    topics.SOIL_CONVERSIONS,
    topics.SOIL_TOOL_SWEEPS,
    topics.SOIL_FORCES,
)


class SlowSubscriber(Node):
    """Takes 0.5 s for each message."""

    def __init__(self) -> None:
        super().__init__("slow_subscriber")
        profile = QoSProfile(depth=10)
        for topic in SLOW_TOPICS:
            self.create_subscription(PointCloud2, f"/{topic}", self._process, profile)

    def _process(self, message: PointCloud2) -> None:
        time.sleep(CALLBACK_TIME)


class CommandFlood(Node):
    """Publishes commands at a high rate."""

    def __init__(self, machine: str) -> None:
        super().__init__("command_flood")
        topic = f"{machine}/{topics.TRACK_VELOCITY_COMMANDS}"
        self._publisher = self.create_publisher(Float64MultiArray, topic, qos.COMMANDS)
        self._command = Float64MultiArray(data=[0.0, 0.0])
        self._start, self._count = time.monotonic(), 0
        self.create_timer(FLOOD_PERIOD, self._publish)
        self.create_timer(1.0, self._report)

    def _publish(self) -> None:
        due = FLOOD_RATE * (time.monotonic() - self._start)
        end = time.monotonic() + FLOOD_PERIOD
        while self._count < due and time.monotonic() < end:
            self._publisher.publish(self._command)
            self._count += 1

    def _report(self) -> None:
        rate = self._count / (time.monotonic() - self._start)
        self.get_logger().info(f"{rate:.0f} commands per second")


def slow_disk_recorder(path: str, seconds: float) -> Callable[[], Node]:
    """Return a function that makes a recorder whose disk is slow for some time [s]."""
    write, end = AtomicFile.write, time.monotonic() + seconds

    def slow_write(file: AtomicFile, data: bytes) -> int:
        if time.monotonic() < end:
            time.sleep(WRITE_TIME)
        return write(file, data)

    def make() -> Node:
        AtomicFile.write = slow_write  # type: ignore[method-assign,assignment]
        values = {"path": path, "progress": False}
        return RecorderNode(
            parameter_overrides=[Parameter(name, value=value) for name, value in values.items()]
        )

    return make


def main(arguments: Sequence[str]) -> int:
    """Run the program that the first argument names; return its exit code."""
    kind, *rest = arguments
    makers: dict[str, Callable[[], Callable[[], Node]]] = {
        "slow_subscriber": lambda: SlowSubscriber,
        "command_flood": lambda: lambda: CommandFlood(rest[0]),
        "slow_disk": lambda: slow_disk_recorder(rest[0], float(rest[1])),
    }
    return run_node(makers[kind](), [kind], name=kind)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
