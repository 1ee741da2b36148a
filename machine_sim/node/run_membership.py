"""Membership of a machine node in a run of the soil: joining, rejoining, and lost messages.

A run begins for the node once the run's parameters (`sim/config`) and its terrain (a keyframe) have
arrived with the same run id. The node then joins; it asks again while required subscribers are
missing, after it was dropped, and every `_REJOIN_PERIOD` after a rejection. While no tick
progresses it requests missing rows again. The caller passes the wall clock and sends the messages.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from machine_sim.node.machine_run import MachineRun
from msg_bridge.codec.run_config import RunFacts
from msg_bridge.contract.messages import Keyframe
from msg_bridge.exchange.join_state import JoinState
from msg_bridge.nodes.diagnostics import Diagnostics, Level

__all__ = ["RunMembership"]

_REJOIN_PERIOD = 5.0
"""Wall time between two requests to join after a rejection [s]."""

_LOG_PERIOD = 2.0
"""Minimum wall time between two log lines on missing subscribers [s]."""

_REJECTION_LOG_PERIOD = 5.0
"""Minimum wall time between two log lines on a rejection [s]."""


class Logger(Protocol):
    """The part of a node's logger that is used here."""

    def info(self, message: str, *, throttle_duration_sec: float = ...) -> object: ...
    def warning(self, message: str) -> object: ...
    def error(self, message: str, *, throttle_duration_sec: float = ...) -> object: ...


class RunMembership:
    """Joins the runs of the soil, and recovers from drops, rejections and lost messages.

    Attributes:
        facts: parameters of the latest run; None until they have arrived.
        keyframe: first keyframe of the latest run; None until it has arrived.
    """

    def __init__(
        self,
        missing_subscribers: Callable[[], list[str]],
        send: Callable[[MachineRun], None],
        diagnostics: Diagnostics,
        logger: Logger,
    ) -> None:
        """
        Args:
            missing_subscribers: returns the topics that a required subscriber does not subscribe.
            send: sends the messages that a run's exchange has produced.
            diagnostics: diagnostics of the node.
            logger: logger of the node.
        """
        self.facts: RunFacts | None = None
        self.keyframe: Keyframe | None = None
        self._missing_subscribers, self._send = missing_subscribers, send
        self._diagnostics, self._logger = diagnostics, logger
        self._last_progress: tuple[int, int, int, JoinState] | None = None
        self._stalled_since = 0.0  # wall clock [s]

    def is_first_keyframe(self, keyframe: Keyframe) -> bool:
        """Return whether no keyframe of its run has arrived before."""
        return self.keyframe is None or keyframe.run_id != self.keyframe.run_id

    def new_run(self, current: MachineRun | None) -> tuple[RunFacts, Keyframe] | None:
        """Return parameters and terrain of a run that has begun.

        Args:
            current: the present run of the node.

        Returns:
            None if there is no run other than `current`, or if its data is incomplete.
        """
        facts, keyframe = self.facts, self.keyframe
        if facts is None or keyframe is None or facts.run_id != keyframe.run_id:
            return None
        if current is not None and current.facts.run_id == facts.run_id:
            return None
        return facts, keyframe

    def join(self, run: MachineRun) -> None:
        """Request to join a run, once all required subscribers are there."""
        missing = self._missing_subscribers()
        if missing:
            text = f"waiting for subscribers of {', '.join(missing)}"
            self._logger.info(text, throttle_duration_sec=_LOG_PERIOD)
            return
        run.endpoint.join()
        self._send(run)

    def handle_not_joined(self, run: MachineRun) -> None:
        """Rejoin a run that dropped the node, and report a rejection."""
        exchange = run.endpoint.exchange
        if exchange.dropped:
            self._logger.warning("the soil dropped this node from the run; rejoining")
            self._diagnostics.count("times_dropped")
            self.join(run)
        elif exchange.rejection_reason:
            text = f"rejected by the soil: {exchange.rejection_reason}"
            self._diagnostics.problem(text, Level.ERROR)
            self._logger.error(text, throttle_duration_sec=_REJECTION_LOG_PERIOD)

    def recover(self, run: MachineRun, now: float) -> None:
        """Request missing messages if nothing has progressed since the last call, or join again.

        Progress is judged by the state of the exchange, since messages to other nodes arrive too.

        Args:
            run: the present run.
            now: a monotonic wall clock [s].
        """
        exchange = run.endpoint.exchange
        progress = (exchange.run_id, exchange.session_id, exchange.tick, exchange.join_state)
        is_stalled = progress == self._last_progress
        if not is_stalled:
            self._last_progress, self._stalled_since = progress, now
        if exchange.join_state is JoinState.OUT:
            # A rejection is repeated unless something has changed.
            if not exchange.rejection_reason or now - self._stalled_since >= _REJOIN_PERIOD:
                self.join(run)
        elif is_stalled:
            exchange.request_missing()
            self._send(run)
