"""Membership of a machine node in a run of the soil: joining, rejoining, and lost messages.

A run begins for the node once the run's parameters (`sim/config`) and its terrain (a keyframe) have
arrived with the same run id. The node then joins; it asks again while required subscribers are
missing, after it was dropped, and every `_REJOIN_PERIOD` after a rejection. While no tick
progresses it requests missing rows again. The caller passes the wall clock and sends the messages.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np

from machine_sim.node.machine_run import MachineRun
from msg_bridge.codec.run_config import RunFacts
from msg_bridge.contract import topics
from msg_bridge.contract.constants import MAX_MAP_CELLS
from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.messages import Keyframe
from msg_bridge.exchange.join_state import JoinState
from msg_bridge.nodes.diagnostics import Diagnostics, Level

__all__ = ["RunMembership"]

_REJOIN_PERIOD = 5.0
"""Wall time between two requests to join after a rejection [s]."""

_MAX_REJECTED_WELCOMES = 4
"""Number of times that terrain and backlog of a join are requested before the soil is given up."""

_REJECTION_LOG_PERIOD = 5.0
"""Minimum wall time between two log lines on a rejection [s]."""


class Logger(Protocol):
    """The part of a node's logger that is used here."""

    def warning(self, message: str) -> object: ...
    def error(self, message: str, *, throttle_duration_sec: float = ...) -> object: ...


class RunMembership:
    """Joins the runs of the soil, and recovers from drops, rejections and lost messages.

    Attributes:
        facts: parameters of the latest run; None until they have arrived.
        keyframe: first keyframe of the latest run; None until it has arrived.
        missing_subscribers: topics that a required subscriber did not subscribe to, at the last
            attempt to join.
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
        self.missing_subscribers: list[str] = []
        self._contested_run_ids: set[int] = set()
        self._find_missing_subscribers, self._send = missing_subscribers, send
        self._diagnostics, self._logger = diagnostics, logger
        self._last_progress: tuple[int, int, int, JoinState] | None = None
        self._stalled_since = 0.0  # wall clock [s]

    def announce(self, facts: RunFacts, current: MachineRun | None, *, is_contested: bool) -> None:
        """Set the parameters of a run that was announced.

        Args:
            facts: its parameters.
            current: the present run of the node.
            is_contested: whether the announcement has more than one publisher. It may be that of
                another soil node then, so the present run continues while its soil sends messages.
        """
        self.facts = facts
        if not is_contested:
            self._contested_run_ids.discard(facts.run_id)
            return
        self._contested_run_ids.add(facts.run_id)
        if current is not None and current.facts.run_id != facts.run_id:
            self._logger.warning(
                f"run {facts.run_id} was announced, but there is more than one publisher of the"
                f" configuration: this node remains in run {current.facts.run_id} while its soil"
                " node sends; end the other publisher"
            )

    def resume(self, facts: RunFacts, keyframe: Keyframe) -> None:
        """Take part in a run that a process before has joined.

        Args:
            facts: parameters of the run.
            keyframe: terrain on which the machines were placed.
        """
        self.facts, self.keyframe = facts, keyframe

    def is_held(self, current: MachineRun | None, *, soil_is_silent: bool) -> bool:
        """Return whether the run that was announced must wait for the end of the present one.

        Args:
            current, soil_is_silent: as for `new_run`.
        """
        if current is None or self.facts is None or soil_is_silent:
            return False
        return self.facts.run_id in self._contested_run_ids

    def needs_maps(self, current: MachineRun | None) -> bool:
        """Return whether the node should receive terrain maps.

        To receive a large terrain takes longer than a tick, so a node that takes part does not.

        Args:
            current: the present run of the node.
        """
        if current is None or self.facts is None or self.keyframe is None:
            return True
        is_large = self.keyframe.elevation.size > MAX_MAP_CELLS
        return not is_large or current.needs_map(self.facts.run_id)

    def offer_keyframe(self, keyframe: Keyframe) -> bool:
        """Keep the first keyframe of a run; return whether it was kept.

        Raises:
            ExchangeError: VALUE: its terrain cannot be that of the run that was announced.
        """
        if self.keyframe is not None and keyframe.run_id == self.keyframe.run_id:
            return False
        facts = self.facts
        if facts is not None and facts.run_id == keyframe.run_id:
            _check_keyframe(keyframe, facts)
        self.keyframe = keyframe
        return True

    def new_run(
        self, current: MachineRun | None, *, soil_is_silent: bool
    ) -> tuple[RunFacts, Keyframe] | None:
        """Return parameters and terrain of a run that has begun.

        Args:
            current: the present run of the node.
            soil_is_silent: whether the soil sends no messages of the present run.

        Returns:
            None if there is no run other than `current`, if its data is incomplete, or if it may be
            that of another soil node, see `announce`.
        """
        facts, keyframe = self.facts, self.keyframe
        if facts is None or keyframe is None or facts.run_id != keyframe.run_id:
            return None
        try:
            _check_keyframe(keyframe, facts)
        except ExchangeError as error:  # it arrived before the parameters
            self._diagnostics.reject(topics.TERRAIN_MAP, error.coded_message)
            self.keyframe = None
            return None
        is_held = self.is_held(current, soil_is_silent=soil_is_silent)
        is_same = current is not None and current.facts.run_id == facts.run_id
        return None if is_held or is_same else (facts, keyframe)

    def find_missing_subscribers(self) -> list[str]:
        """Update and return `missing_subscribers`."""
        self.missing_subscribers = self._find_missing_subscribers()
        return self.missing_subscribers

    def join(self, run: MachineRun) -> None:
        """Request to join a run, once all required subscribers are there."""
        if self.find_missing_subscribers():
            return
        run.join()
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

    def _discard_soil(self, run: MachineRun) -> None:
        """Discard soil with which the machine cannot return: the terrain has it, or counts it as
        absent."""
        volume = run.discard_soil()
        self._diagnostics.count("times_soil_discarded")
        self._logger.error(
            f"the soil node does not count the {volume} mm3 of soil in the machine as the machine's"
            " any more: they are removed, and the machine joins without soil; what it held is"
            " terrain or absent, see /soil/ledger"
        )

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
                if exchange.rejection_reason.startswith(ErrorCode.REJOIN_VOLUME):
                    self._discard_soil(run)
                self.join(run)
        elif run.endpoint.num_rejected_welcomes >= _MAX_REJECTED_WELCOMES:
            exchange.abandon_session()
            self._discard_soil(run)
            self.join(run)
        elif exchange.is_desynchronized and exchange.joined:
            self._logger.warning(
                "soil and machine count the rows of this session differently, as after messages of"
                " another publisher; rejoining with the soil that the machine holds"
            )
            self._diagnostics.count("times_desynchronized")
            exchange.abandon_session()
            self.join(run)
        elif is_stalled:
            exchange.request_missing()
            self._send(run)


def _check_keyframe(keyframe: Keyframe, facts: RunFacts) -> None:
    """Check that heights and soils of a terrain are possible in a run.

    Raises:
        ExchangeError: VALUE.
    """
    if not np.isfinite(keyframe.elevation).all() or keyframe.soil.max() >= len(facts.soils):
        raise ExchangeError(
            "a terrain map has heights that are not finite, or soils unknown in the run",
            ErrorCode.VALUE,
        )
