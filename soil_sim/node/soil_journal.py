"""The journal of the soil's runs, from which a restarted node continues one.

Independent of ROS and of clocks. Without a `RunJournal` nothing is written.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from msg_bridge.checkpoint.state_pickle import capture_state
from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import Message
from msg_bridge.recovery.errors import DivergenceError, RecoveryError
from msg_bridge.recovery.run_journal import RunJournal, SavedRun
from soil_sim.endpoint import SoilEndpoint
from soil_sim.tick_record import MachineDrop, SoilRelease, SoilTickRecord

__all__ = ["ResentTick", "RestoredSoil", "SoilJournal", "SoilRunBegin", "TimeControl", "restore"]

_NUM_RESENT_TICKS = 3
"""Number of the last ticks whose messages are sent again: the process may have died before."""


class SoilRunBegin(NamedTuple):
    """What a run begins with.

    Attributes:
        run_id: number of the run.
        config: its configuration [YAML].
    """

    run_id: int
    config: str


class TimeControl(NamedTuple):
    """Whether time stands still.

    Attributes:
        paused: whether it does.
        requested_tick: last tick requested while it does.
    """

    paused: bool
    requested_tick: int


class ResentTick(NamedTuple):
    """A tick to publish again after a restart.

    Attributes:
        ledger: its ledger.
        messages: what the soil sent.
    """

    ledger: Ledger
    messages: list[Message]


class RestoredSoil(NamedTuple):
    """The soil of a run as it was when its process ended.

    Attributes:
        endpoint: soil and its end of the exchange.
        time: whether time stands still.
        last_ticks: the last ticks, in order.
    """

    endpoint: SoilEndpoint
    time: TimeControl
    last_ticks: list[ResentTick]


class SoilJournal:
    """Writes the inputs of the soil."""

    def __init__(self, journal: RunJournal | None) -> None:
        """
        Args:
            journal: the journal of the node; None: nothing is written.
        """
        self._journal = journal
        self._events: list[MachineDrop | SoilRelease] = []  # since the last tick

    def begin(self, run_id: int, config: str) -> None:
        """Begin the journal of a run."""
        self._events.clear()
        if self._journal is not None:
            self._journal.begin(SoilRunBegin(run_id, config))

    def add_event(self, event: MachineDrop | SoilRelease) -> None:
        """Add what happened before the next tick."""
        if self._journal is not None:
            self._events.append(event)

    def record_tick(self, endpoint: SoilEndpoint) -> None:
        """Record the inputs of the tick that an endpoint is about to compute."""
        if self._journal is not None:
            messages = endpoint.exchange.polled_messages()
            self._journal.append(SoilTickRecord.of(endpoint, self._events, messages))
            self._events.clear()

    def record_time(self, time: TimeControl) -> None:
        """Record that time was stopped or continued, or that a step was requested."""
        if self._journal is not None:
            self._journal.append(time)

    def checkpoint_if_due(self, endpoint: SoilEndpoint, time: TimeControl) -> None:
        """Write a checkpoint after a tick, if it is time for one."""
        if self._journal is not None and not self._events:
            self._journal.checkpoint_if_due(lambda _: capture_state((endpoint, time)))


def restore(saved: SavedRun, endpoint: SoilEndpoint, time: TimeControl) -> RestoredSoil:
    """Return the soil of a saved run.

    Args:
        saved: the run.
        endpoint: the soil as the run began; it is used if there is no checkpoint.
        time: whether time stood still then.

    Raises:
        RecoveryError: its ticks cannot be computed again.
    """
    if saved.state is not None:
        endpoint, time = saved.state
        endpoint.exchange.discard_unprocessed()
    last_ticks: deque[ResentTick] = deque(maxlen=_NUM_RESENT_TICKS)
    for record in _checked(saved.records):
        if isinstance(record, TimeControl):
            time = record
            continue
        try:
            done = record.compute(endpoint)
        except ExchangeError as error:
            raise DivergenceError(endpoint.tick + 1, error.coded_message) from error
        last_ticks.append(ResentTick(done.ledger, endpoint.drain_outbox()))
    return RestoredSoil(endpoint, time, list(last_ticks))


def _checked(records: Iterable[object]) -> Iterable[SoilTickRecord | TimeControl]:
    """Yield records of the soil.

    Raises:
        RecoveryError: one is of something else.
    """
    for record in records:
        if not isinstance(record, (SoilTickRecord, TimeControl)):
            raise RecoveryError(f"a record is of type {type(record).__name__}")
        yield record
