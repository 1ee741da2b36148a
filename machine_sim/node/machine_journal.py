"""The journal of a machine node, from which a restarted node continues its run.

Independent of ROS and of clocks. Without a `RunJournal` nothing is written.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from machine_sim.commands import AppliedCommand, CommandSource
from machine_sim.endpoint import MachineEndpoint
from machine_sim.machine import MachineError
from machine_sim.node.reported_motion import TickProgress
from machine_sim.physics_state import dump_physics, restore_physics
from machine_sim.tick_record import (
    ArbiterRecord,
    ArbiterStates,
    JoinRecord,
    MachineTickRecord,
)
from msg_bridge.checkpoint.state_pickle import CapturedState, capture_state
from msg_bridge.codec.run_config import RunFacts
from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import Keyframe, Message
from msg_bridge.recovery.errors import DivergenceError, RecoveryError
from msg_bridge.recovery.run_journal import RunJournal, SavedRun

__all__ = [
    "MachineJournal",
    "MachineRunBegin",
    "MachineRunState",
    "OnTick",
    "RestoredMachines",
    "restore",
]


class MachineRunBegin(NamedTuple):
    """What the run of a node begins with.

    Attributes:
        facts: parameters of the run.
        keyframe: terrain on which the machines were placed.
        session_id: number from which the sessions of the node count.
        config: its configuration [YAML].
    """

    facts: RunFacts
    keyframe: Keyframe
    session_id: int
    config: str


class MachineRunState(NamedTuple):
    """The machines after a tick.

    Attributes:
        endpoint: machines and their end of the exchange; the bodies are in `physics`.
        progress: see `MachineRun`.
        arbiters: commands in force.
        client_id: id of their physics client.
        physics: see `dump_physics`; empty before it is dumped.
        is_exact: whether the bodies move as before once their state is restored.
    """

    endpoint: MachineEndpoint
    progress: TickProgress
    arbiters: ArbiterStates
    client_id: int
    physics: bytes = b""
    is_exact: bool = True


OnTick = Callable[[MachineRunState, list[AppliedCommand], list[Message]], None]
"""What is called after a tick that is performed again: with the state, without physics, and the
command of each machine, whose sources are not known any more, and the messages of the tick; both
are empty for the state that the run continues from."""


class RestoredMachines(NamedTuple):
    """The machines of a run as they were when their process ended.

    Attributes:
        state: the machines.
        num_skipped: number of ticks that were not performed again: poses are those before them, and
            the machines are to rejoin with the soil that they hold after them.
    """

    state: MachineRunState
    num_skipped: int


class MachineJournal:
    """Writes the inputs of the machines of a node."""

    def __init__(self, journal: RunJournal | None) -> None:
        """
        Args:
            journal: the journal of the node; None: nothing is written.
        """
        self._journal = journal
        self._arbiters: ArbiterStates | None = None  # as recorded last

    def begin(self, begin: MachineRunBegin) -> None:
        """Begin the journal of a run."""
        self._arbiters = None
        if self._journal is not None:
            self._journal.begin(begin)

    def record_join(self, *, discards_soil: bool) -> None:
        """Record a request to join."""
        if self._journal is not None:
            self._journal.append(JoinRecord(discards_soil))

    def record_tick(
        self,
        endpoint: MachineEndpoint,
        commands: Sequence[AppliedCommand],
        arbiters: ArbiterStates,
        *,
        leave: bool,
    ) -> None:
        """Record the inputs of the tick that is about to be performed.

        Args:
            endpoint: it performs the tick.
            commands: command of each machine.
            arbiters: commands that remain in force.
            leave: whether it is the last tick of the session.
        """
        if self._journal is None:
            return
        changed = None if arbiters == self._arbiters else arbiters
        self._arbiters = arbiters
        record = MachineTickRecord.of(endpoint, commands, arbiters=changed, leave=leave)
        self._journal.append(record)

    def record_arbiters(self, arbiters: ArbiterStates) -> None:
        """Record the commands in force between two ticks, if they have changed."""
        if self._journal is not None and arbiters != self._arbiters:
            self._arbiters = arbiters
            self._journal.append(ArbiterRecord(arbiters))

    def checkpoint_if_due(
        self, state: Callable[[], MachineRunState], *, is_preferred: bool = True
    ) -> None:
        """Write a checkpoint after a tick, if it is time for one.

        Args:
            state: returns the state without physics.
            is_preferred: whether not to wait for a later tick, for up to a period.
        """

        def capture(is_overdue: bool) -> CapturedState | None:
            if not (is_preferred or is_overdue):
                return None
            return _capture(state(), allow_contacts=is_overdue)

        if self._journal is not None:
            self._journal.checkpoint_if_due(capture)


def restore(
    saved: SavedRun, state: MachineRunState, on_tick: OnTick, *, skip: bool = False
) -> RestoredMachines:
    """Return the machines of a saved run.

    Args:
        saved: the run.
        state: the machines as the run began; their bodies are used, in the physics client of the
            saved state.
        on_tick: called with the state that the run continues from, and after each tick.
        skip: whether to skip the ticks after the saved state, not to perform them again. They are
            skipped anyway after a state that is not exact.

    Raises:
        DivergenceError: their ticks have other results than before.
        MachineError: they hold less soil than they have deposited.
    """
    if saved.state is not None:
        saved.state.endpoint.sim.take_bodies(state.endpoint.sim)
        state = saved.state
        restore_physics(state.client_id, state.physics)
        state.endpoint.exchange.discard_unprocessed()
    skip = skip or not state.is_exact
    num_skipped = 0
    endpoint = state.endpoint
    on_tick(state, [], [])
    for record in saved.records:
        if isinstance(record, ArbiterRecord):
            state = state._replace(arbiters=record.states)
        elif isinstance(record, JoinRecord):
            record.perform(endpoint)
        elif isinstance(record, MachineTickRecord) and skip:
            record.skip(endpoint)
            state = state._replace(arbiters=record.arbiters or state.arbiters)
            num_skipped += 1
        elif isinstance(record, MachineTickRecord):
            before = endpoint.tick
            try:
                record.perform(endpoint)
            except ExchangeError as error:
                raise DivergenceError(endpoint.next_tick, error.coded_message) from error
            state = state._replace(
                arbiters=record.arbiters or state.arbiters,
                progress=state.progress.after_tick(endpoint.tick - before),
            )
            endpoint.sim.contacts.take_changes()  # they were published
            on_tick(state, [_applied(*each) for each in record.commands], endpoint.drain_outbox())
        else:
            raise RecoveryError(f"a record is of type {type(record).__name__}")
    return RestoredMachines(state, num_skipped)


def _applied(joints: list[float], tracks: list[float]) -> AppliedCommand:
    unknown: CommandSource = "none"
    sources = (unknown,) * len(joints), (unknown,) * len(tracks)
    return AppliedCommand(np.array(joints), np.array(tracks), *sources)


def _capture(state: MachineRunState, *, allow_contacts: bool) -> CapturedState | None:
    """Return a state with its physics; None while bodies touch, unless that is allowed."""
    try:
        physics = dump_physics(state.client_id)
    except MachineError:
        if not allow_contacts:
            return None
        physics = dump_physics(state.client_id, allow_contacts=True)
        state = state._replace(is_exact=False)
    return capture_state(state._replace(physics=physics))
