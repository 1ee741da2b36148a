"""The run that a machine node continues after a crash."""

from __future__ import annotations

from collections.abc import Callable, Collection
from contextlib import nullcontext
from functools import partial
from typing import NamedTuple

from machine_sim.node.machine_journal import (
    MachineRunBegin,
    ResentTick,
    RestoredMachines,
    restore,
)
from machine_sim.node.machine_run import MachineRun
from machine_sim.physics_state import next_client
from msg_bridge.codec.run_config import RunFacts
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.messages import Keyframe
from msg_bridge.recovery.config_comparison import find_config_difference
from msg_bridge.recovery.errors import DivergenceError, RecoveryError
from msg_bridge.recovery.node_recovery import NodeRecovery
from msg_bridge.recovery.run_journal import SavedRun

__all__ = ["ContinuedRun", "continue_run"]


class ContinuedRun(NamedTuple):
    """A run that continues.

    Attributes:
        run: the machines as they were when their process ended.
        begin: what their run began with.
        last_ticks: their last ticks, in order, to be published again.
    """

    run: MachineRun
    begin: MachineRunBegin
    last_ticks: list[ResentTick]


def continue_run(
    recovery: NodeRecovery,
    make_run: Callable[[RunFacts, Keyframe, int], MachineRun],
    make_config: Callable[[MachineRun, int], str],
    ignored: Collection[str],
) -> ContinuedRun | None:
    """Return the run that a process before did not end; None if there is none, or on an error.

    Args:
        recovery: recovery of the node; it reports the outcome.
        make_run: returns the machines as a run began, from its parameters, terrain and the number
            from which its sessions count.
        make_config: returns the configuration of a run [YAML], from that number.
        ignored: names of the parameters that may have changed.
    """
    saved = recovery.saved_run()
    if saved is None:
        return None
    begin: MachineRunBegin = saved.begin
    restored_run = partial(_restored_run, make_run, make_config, ignored)
    try:
        try:
            run, restored = restored_run(saved, skip=False)
        except DivergenceError as error:
            recovery.warn(str(error))
            saved = recovery.saved_run() or saved  # the state before it was changed
            run, restored = restored_run(saved, skip=True)
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
    return ContinuedRun(run, begin, restored.last_ticks)


def _restored_run(
    make_run: Callable[[RunFacts, Keyframe, int], MachineRun],
    make_config: Callable[[MachineRun, int], str],
    ignored: Collection[str],
    saved: SavedRun,
    *,
    skip: bool,
) -> tuple[MachineRun, RestoredMachines]:
    """Return the machines of a saved run and what they continue from; arguments as above.

    Raises:
        EarthmovingError: the run has other parameters, or cannot be restored.
    """
    begin: MachineRunBegin = saved.begin
    client = nullcontext() if saved.state is None else next_client(saved.state.client_id)
    with client:
        run = make_run(begin.facts, begin.keyframe, begin.session_id)
    try:
        config = make_config(run, begin.session_id)
        difference = find_config_difference(begin.config, config, ignored=ignored)
        if difference:
            raise RecoveryError(f"it has other parameters: {difference}")
        return run, restore(saved, run.state, skip=skip)
    except BaseException:
        run.close()
        raise
