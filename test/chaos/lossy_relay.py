"""LossyRelay: passes the messages of the exchange between soil and a machine, and loses some."""

from __future__ import annotations

from collections import Counter
from functools import partial
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.publisher import Publisher
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Int64MultiArray

from msg_bridge.codec.qos import ROWS
from msg_bridge.contract import topics

__all__ = ["LossyRelay"]

_FLUSH_PERIOD = 0.02
"""Wall time after which a message that waits is overtaken no more [s]."""

_TO_SOIL = {
    f"/{topics.SOIL_TOOL_SWEEPS}": PointCloud2,
    f"/{topics.SOIL_DEPOSIT_REQUESTS}": PointCloud2,
    f"/excavator/{topics.MACHINE_TICK}": Int64MultiArray,
}
_TO_MACHINE = {
    f"/{topics.SOIL_TICK}": Int64MultiArray,
    f"/{topics.SOIL_CONVERSIONS}": PointCloud2,
    f"/{topics.TERRAIN_MAP_UPDATES}": PointCloud2,
    f"/{topics.SOIL_FORCES}": PointCloud2,
    f"/excavator/{topics.CONVERSION_BACKLOG}": PointCloud2,
}
_SIDE = "/lossy"
"""Prefix of the topics at the machine's side."""


class LossyRelay(Node):
    """Drops, doubles and delays messages of each topic of the exchange but the terrain.

    Attributes:
        fates: number of messages that were dropped, doubled, delayed and passed.
    """

    remappings = tuple(f"{topic}:={_SIDE}{topic}" for topic in (*_TO_SOIL, *_TO_MACHINE))
    """Remappings of a machine node whose messages pass through the relay."""

    def __init__(self, *, seed: int, drop: float, double: float, delay: float, **kwargs: Any):
        """
        Args:
            seed: seed of the losses.
            drop, double, delay: probability of each for a message.
            kwargs: arguments of `rclpy.node.Node`.
        """
        super().__init__("lossy_relay", **kwargs)
        self.fates: Counter[str] = Counter()
        self._rng = np.random.default_rng(seed)
        self._names = ["dropped", "doubled", "delayed", "passed"]
        self._odds = [drop, double, delay, 1.0 - drop - double - delay]
        self._waiting: list[tuple[Publisher, bytes]] = []
        for topic, kind in _TO_SOIL.items():
            self._relay(kind, _SIDE + topic, topic)
        for topic, kind in _TO_MACHINE.items():
            self._relay(kind, topic, _SIDE + topic)
        self.create_timer(_FLUSH_PERIOD, self._flush)

    def _relay(self, kind: type, source: str, target: str) -> None:
        publisher = self.create_publisher(kind, target, ROWS)
        self.create_subscription(kind, source, partial(self._take, publisher), ROWS, raw=True)

    def _take(self, publisher: Publisher, data: bytes) -> None:
        fate = str(self._rng.choice(self._names, p=self._odds))
        self.fates[fate] += 1
        if fate == "delayed":  # messages of all topics overtake it
            self._waiting.append((publisher, data))
        elif fate != "dropped":
            for _ in range(2 if fate == "doubled" else 1):
                publisher.publish(data)

    def _flush(self) -> None:
        """Publish the messages that wait, in another order."""
        waiting, self._waiting = self._waiting, []
        for k in self._rng.permutation(len(waiting)):
            publisher, data = waiting[k]
            publisher.publish(data)
