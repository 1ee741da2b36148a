"""WaitLog: logs that a node waits for the soil's configuration, so that it does not wait silently.

The usual cause is a wrong namespace: then the topic of the node is not that of the soil, and no
message will ever arrive.
"""

from __future__ import annotations

from collections.abc import Callable

from msg_bridge.nodes.sim_node import SimNode

__all__ = ["FIRST_LOG_TIME", "LOG_PERIOD", "WaitLog"]

FIRST_LOG_TIME = 5.0
"""Wall time without a message after which the wait is logged [s]."""

LOG_PERIOD = 30.0
"""Wall time between further log lines [s]."""


class WaitLog:
    """Logs after `FIRST_LOG_TIME`, and then every `LOG_PERIOD`, until the wait is over."""

    def __init__(self, node: SimNode, text: str, is_waiting: Callable[[], bool]) -> None:
        """
        Args:
            node: the node that waits.
            text: what it waits for, and what to check.
            is_waiting: returns whether it still waits; after a False there are no more lines.
        """
        self._node, self._text, self._is_waiting = node, f"waiting for {text}", is_waiting
        self._timer = node.create_timer(FIRST_LOG_TIME, self._on_timer)
        self._num_lines = 0

    def _on_timer(self) -> None:
        if not self._is_waiting():
            self._timer.cancel()
            return
        self._node.get_logger().info(self._text)
        self._num_lines += 1
        if self._num_lines == 1:
            self._timer.cancel()
            self._timer = self._node.create_timer(LOG_PERIOD, self._on_timer)
