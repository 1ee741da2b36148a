"""The run that a machine node continues after a crash."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import AbstractContextManager, nullcontext
from types import MappingProxyType
from typing import NamedTuple

from machine_sim.commands import AppliedCommand
from machine_sim.node.machine_journal import (
    MachineRunBegin,
    MachineRunState,
    RestoredMachines,
    restore,
)
from machine_sim.node.machine_run import MachineRun
from machine_sim.node.machine_transport import MachineTransport
from machine_sim.node.node_publishers import NodePublishers
from machine_sim.node.params import MachineNodeParams
from machine_sim.physics_state import next_client
from msg_bridge.codec.run_config import RunFacts
from msg_bridge.codec.stamps import stamp_from_tick
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.messages import Keyframe, Message
from msg_bridge.nodes.sim_node import HeldPublications
from msg_bridge.recovery.config_comparison import find_config_difference
from msg_bridge.recovery.errors import ChangedParametersError, DivergenceError
from msg_bridge.recovery.node_recovery import NodeRecovery
from msg_bridge.recovery.run_journal import SavedRun

__all__ = ["ContinuedRun", "LastTicks", "RunSetup", "continue_run"]

_NONE: Mapping[int, HeldPublications] = MappingProxyType({})

_MIN_REPEATED_TICKS = 3
"""Minimum number of the last ticks that are published again: the process may have died before."""

_MAX_REPEATS = 20
"""Number of times that states are published again whose answers are missing, every 0.25 s."""

_MAX_RECORDS_PER_TICK = 4
"""Records of a tick, and of the commands that arrived before it."""


class RunSetup(NamedTuple):
    """How a node sets up the machines of a run.

    Attributes:
        make_run: returns the machines as a run began, from its parameters, terrain and the number
            from which its sessions count.
        make_config: returns the configuration of a run [YAML], from that number.
        ignored: names of the parameters that may have changed.
        hold_publications: holds what is published in its context.
        publishers, transport: what publishes the ticks.
        params: parameters of the node.
    """

    make_run: Callable[[RunFacts, Keyframe, int], MachineRun]
    make_config: Callable[[MachineRun, int], str]
    ignored: Collection[str]
    hold_publications: Callable[[], AbstractContextManager[HeldPublications]]
    publishers: NodePublishers
    transport: MachineTransport
    params: MachineNodeParams

    def hold_tick(
        self, run: MachineRun, commands: list[AppliedCommand], messages: list[Message]
    ) -> tuple[HeldPublications, HeldPublications]:
        """Return the publications of the last tick of a run: those to the soil, and of its state.

        Args:
            run: the machines after the tick.
            commands: command of each machine; empty if they are not known.
            messages: messages to the soil.
        """
        stamp = stamp_from_tick(run.tick, run.facts.tick_period)
        with self.hold_publications() as of_tick:
            if commands:
                self.publishers.publish_applied_commands(commands, stamp)
            self.transport.send(messages, stamp)
        with self.hold_publications() as of_state:
            self.publishers.publish_state(run, self.params)
        return of_tick, of_state


class LastTicks:
    """The last ticks of a run before a restart, to be published again.

    Attributes:
        is_published: whether all but the states is published.
    """

    def __init__(
        self,
        publications: HeldPublications | None = None,
        states: Mapping[int, HeldPublications] = _NONE,
    ) -> None:
        """
        Args:
            publications: all but the states; None if there was no restart.
            states: the state after each tick, by tick.
        """
        self._publications, self._states = publications or (), states
        self.is_published = publications is None
        self._num_repeats = 0  # of the states

    def publish(self) -> None:
        """Publish the ticks without the states."""
        for publish in self._publications:
            publish()
        self.is_published = True

    def publish_unanswered_states(self, run: MachineRun) -> None:
        """Publish the states before the present one whose answers were lost.

        A controller that answers only the newest state is not waited for without end.
        """
        ticks = run.unanswered_ticks & self._states.keys() - {run.tick}
        if not ticks:
            return
        if self._num_repeats == _MAX_REPEATS:
            run.accept_later_answers()
            return
        self._num_repeats += 1
        for tick in sorted(ticks):
            for publish in self._states[tick]:
                publish()


class ContinuedRun(NamedTuple):
    """A run that continues.

    Attributes:
        run: the machines as they were when their process ended.
        begin: what their run began with.
        last_ticks: its last ticks.
    """

    run: MachineRun
    begin: MachineRunBegin
    last_ticks: LastTicks


def continue_run(recovery: NodeRecovery, setup: RunSetup) -> ContinuedRun | None:
    """Return the run that a process before did not end; None if there is none, or on an error.

    Args:
        recovery: recovery of the node; it reports the outcome.
        setup: how the node sets up its runs.

    Raises:
        ChangedParametersError: the node has other parameters than the run.
    """
    saved = recovery.saved_run()
    if saved is None:
        return None
    begin: MachineRunBegin = saved.begin
    try:
        try:
            run, restored, last_ticks = _restored_run(setup, saved, skip=False)
        except DivergenceError as error:
            recovery.warn(str(error))
            saved = recovery.saved_run() or saved  # the state before it was changed
            run, restored, last_ticks = _restored_run(setup, saved, skip=True)
    except ChangedParametersError:
        raise
    except EarthmovingError as error:
        recovery.reject(str(error))
        return None
    run.resume(restored.state)
    what = f"run {begin.facts.run_id} at tick {run.tick}"
    if restored.num_skipped:
        what += (
            f", {restored.num_skipped} ticks before the crash, with the soil that the machines held"
            " then,"
        )
    recovery.resume(saved, what)
    return ContinuedRun(run, begin, last_ticks)


def _restored_run(
    setup: RunSetup, saved: SavedRun, *, skip: bool
) -> tuple[MachineRun, RestoredMachines, LastTicks]:
    """Return the machines of a saved run, what they continue from, and their last ticks.

    Args:
        setup: how the node sets up its runs.
        saved: the run.
        skip: as for `restore`.

    Raises:
        EarthmovingError: the run has other parameters, or cannot be restored.
    """
    begin: MachineRunBegin = saved.begin
    client = nullcontext() if saved.state is None else next_client(saved.state.client_id)
    with client:
        run = setup.make_run(begin.facts, begin.keyframe, begin.session_id)
    try:
        config = setup.make_config(run, begin.session_id)
        difference = find_config_difference(begin.config, config, ignored=setup.ignored)
        if difference:
            raise ChangedParametersError(difference)
        setup.publishers.reset(setup.params.seed)
        num_ticks = max(_MIN_REPEATED_TICKS, run.num_delayed_states)
        num_left = saved.num_records  # records that are not processed yet
        last: deque[tuple[int, HeldPublications, HeldPublications]] = deque(maxlen=num_ticks)

        def count(records: Iterator[object]) -> Iterator[object]:
            nonlocal num_left
            for record in records:
                num_left -= 1
                yield record

        def publish(
            state: MachineRunState, commands: list[AppliedCommand], messages: list[Message]
        ) -> None:
            if state.endpoint.tick < 0 or num_left > _MAX_RECORDS_PER_TICK * num_ticks:
                return
            run.resume(state)
            last.append((run.tick, *setup.hold_tick(run, commands, messages)))

        saved = saved._replace(records=count(saved.records))
        restored = restore(saved, run.state, publish, skip=skip)
    except BaseException:
        run.close()
        raise
    publications = [each for _, of_tick, _ in last for each in of_tick]
    states = {tick: of_state for tick, _, of_state in last}
    return run, restored, LastTicks(publications, states)
