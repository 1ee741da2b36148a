"""WaitLog: logs what a node waits for after its start, so that it does not wait silently.

The usual cause is a wrong namespace: then no message will ever arrive on the topic of the node.
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

    def __init__(self, node: SimNode, awaited: Callable[[], str | None]) -> None:
        """
        Args:
            node: the node that waits.
            awaited: returns what it waits for now, and what to check; None ends the log.
        """
        self._node, self._awaited = node, awaited
        self._timer = node.create_timer(FIRST_LOG_TIME, self._on_timer)
        self._num_lines = 0

    def _on_timer(self) -> None:
        awaited = self._awaited()
        if awaited is None:
            self._timer.cancel()
            return
        self._node.get_logger().info(f"waiting for {awaited}")
        self._num_lines += 1
        if self._num_lines == 1:
            self._timer.cancel()
            self._timer = self._node.create_timer(LOG_PERIOD, self._on_timer)
