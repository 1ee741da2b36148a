"""WaitLog: reports what a node waits for, in its log and its diagnostics.

A wait that lasts longer than `REPORT_TIME` is logged once, is a problem in the diagnostics until it
ends, and is logged again at its end. The usual causes are a peer that was stopped or has ended, and
a wrong namespace, where no message will ever arrive.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from msg_bridge.nodes.diagnostics import Diagnostics

__all__ = ["LOG_PERIOD", "NOTHING", "REPORT_TIME", "Wait", "WaitLog"]

REPORT_TIME = 1.0
"""Wall time after which a wait is reported [s]."""

LOG_PERIOD = 30.0
"""Wall time between two log lines on a wait while it lasts [s]."""

REPEAT_PERIOD = 5.0
"""Minimum wall time between two log lines on waits for the same thing [s]."""

CHECK_PERIOD = 0.25
"""Wall time between two checks [s]."""

NOTHING = "nothing"
"""Value `waiting_for` of a node that does not wait."""

_CONDITION = "waiting"


class Wait(NamedTuple):
    """What a node waits for now.

    Attributes:
        what: completes the sentence "waiting for ..."; while it and `progress` stay the same, it is
            the same wait.
        advice: what to check, and what is known meanwhile; it may change while the wait lasts.
        progress: a value that changes with each thing awaited, such as the tick: then the wait for
            one is over, and the wait for the next begins.
    """

    what: str
    advice: str = ""
    progress: Hashable = None

    @property
    def text(self) -> str:
        """What is awaited, and the advice on it."""
        return f"{self.what}; {self.advice}" if self.advice else self.what


@dataclass
class _PresentWait:
    """A wait that has not ended, as it was found last, since a monotonic wall time [s]."""

    wait: Wait
    since: float
    is_logged: bool = False


class WaitLog:
    """Reports the waits of one node."""

    def __init__(
        self,
        node: Node,
        diagnostics: Diagnostics,
        find_waits: Callable[[], Iterable[Wait]],
        *,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            node: the node, whose log is used.
            diagnostics: its diagnostics.
            find_waits: returns what the node waits for at this moment.
            now: a monotonic wall clock [s].
        """
        self._node, self._diagnostics = node, diagnostics
        self._find_waits, self._now = find_waits, now
        self._present: dict[str, _PresentWait] = {}
        self._last_logged: dict[str, float] = {}  # by what is awaited
        self._is_closed = False
        diagnostics.set("waiting_for", NOTHING)
        diagnostics.add_task(self.update)
        # A timer of the node's own clock would stop with simulation time.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(CHECK_PERIOD, self.update, clock=steady)

    def close(self) -> None:
        """Report nothing from now on: the node ends, which is not the end of what it waits for."""
        self._is_closed = True
        self._present.clear()
        self._diagnostics.set("waiting_for", NOTHING)
        self._diagnostics.clear(_CONDITION)

    def update(self) -> None:
        """Report the waits that have begun or ended."""
        if self._is_closed:
            return
        now = self._now()
        found = {wait.what: wait for wait in self._find_waits()}
        for what, present in list(self._present.items()):
            if what not in found or found[what].progress != present.wait.progress:
                self._end(what, now)
        for what, wait in found.items():
            present = self._present.setdefault(what, _PresentWait(wait, now))
            present.wait = wait
            if now - present.since >= REPORT_TIME:
                self._log(present, now)
        reported = [
            present.wait.text
            for present in self._present.values()
            if now - present.since >= REPORT_TIME
        ]
        self._diagnostics.set("waiting_for", " and ".join(reported) or NOTHING)
        if reported:
            self._diagnostics.problem(f"waiting for {' and '.join(reported)}", condition=_CONDITION)
        else:
            self._diagnostics.clear(_CONDITION)

    def _log(self, present: _PresentWait, now: float) -> None:
        what = present.wait.what
        last = self._last_logged.get(what)
        if last is not None and now - last < (LOG_PERIOD if present.is_logged else REPEAT_PERIOD):
            return
        self._last_logged[what] = now
        so_far = f" (for {now - present.since:.0f} s so far)" if present.is_logged else ""
        self._node.get_logger().warning(f"waiting for {present.wait.text}{so_far}")
        present.is_logged = True

    def _end(self, what: str, now: float) -> None:
        present = self._present.pop(what)
        if present.is_logged:
            self._node.get_logger().info(
                f"the wait of {now - present.since:.1f} s for {what} is over"
            )
