"""Peers of the operator: whether soil and machine are silent, and whether the machine restarted."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from msg_bridge.codec.run_config import parse_session
from msg_bridge.nodes.wait_log import REPORT_TIME, Wait

__all__ = ["PeerMonitor"]

_MAX_SPEED = 5.0
"""Speed above that of any machine [m/s]."""

_POSITION_TOLERANCE = 0.5
"""Displacement that is no jump at any speed [m]."""


class PeerMonitor:
    """Watches the soil and one machine by their messages.

    Attributes:
        paused: whether simulated time stands still.
        soil_time: monotonic wall clock of the last message of the soil [s].
        machine_time: the same, of the machine.
    """

    def __init__(self) -> None:
        self.paused = False
        self.soil_time = self.machine_time = -math.inf
        self._session: tuple[int, int] | None = None
        self.start_run()

    def start_run(self) -> None:
        """Begin a run: the machine starts at its initial pose."""
        self._last_position: Sequence[float] | None = None

    def find_session_change(self, config: str) -> str:
        """Return a sentence if a machine's configuration comes from another process than before.

        Args:
            config: configuration of a machine node, which it publishes once in each run.

        Returns:
            The sentence; empty if the node has not restarted, or the run is another one.

        Raises:
            CodecError: the configuration cannot be read.
        """
        before, self._session = self._session, parse_session(config)
        is_same_run = before is not None and before[0] == self._session[0]
        if not is_same_run or before == self._session:
            return ""
        return "the machine node was restarted: it is at its initial pose, with empty tools"

    def find_jump(self, position: NDArray[np.float64], interval: float) -> str:
        """Return a sentence if the base moved farther than a machine can; else an empty string.

        Args:
            position: present position of the base [m], shape (3,).
            interval: time since the last call [s].
        """
        before, self._last_position = self._last_position, position.tolist()
        if before is None:
            return ""
        distance = math.dist(before, position)
        if distance <= _POSITION_TOLERANCE + _MAX_SPEED * interval:
            return ""
        return (
            f"the machine jumped by {distance:.1f} m within {interval:g} s: it was restarted or put"
            " elsewhere"
        )

    def find_waits(self, last_tick: int, soil_topic: str, machine_topic: str) -> Iterator[Wait]:
        """Yield what the operator waits for after its first command. A pause is no wait.

        Args:
            last_tick: tick of the last sample.
            soil_topic, machine_topic: topics on which the peers should publish.
        """
        now = time.monotonic()
        if now - self.soil_time >= REPORT_TIME:
            yield Wait(
                f"messages of the soil on {soil_topic}",
                "it is stopped or has ended",
                self.soil_time,
            )
        elif self.paused:
            return
        elif now - self.machine_time >= REPORT_TIME:
            yield Wait(
                f"messages of the machine on {machine_topic}",
                "its node is stopped, has ended, or waits itself: see /diagnostics",
                self.machine_time,
            )
        else:
            yield Wait(
                "a tick of which all messages of soil and machine have arrived",
                "see what they wait for in /diagnostics",
                last_tick,
            )
