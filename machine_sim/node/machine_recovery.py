"""The run that a machine node continues after a crash."""

from __future__ import annotations

from collections.abc import Callable, Collection
from contextlib import nullcontext
from typing import NamedTuple

from machine_sim.node.machine_journal import MachineRunBegin, ResentTick, restore
from machine_sim.node.machine_run import MachineRun
from machine_sim.physics_state import next_client
from msg_bridge.codec.run_config import RunFacts
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.messages import Keyframe
from msg_bridge.recovery.config_comparison import find_config_difference
from msg_bridge.recovery.errors import RecoveryError
from msg_bridge.recovery.node_recovery import NodeRecovery

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
    begin, run = saved.begin, None
    client = nullcontext() if saved.state is None else next_client(saved.state.client_id)
    try:
        with client:
            run = make_run(begin.facts, begin.keyframe, begin.session_id)
        config = make_config(run, begin.session_id)
        difference = find_config_difference(begin.config, config, ignored=ignored)
        if difference:
            raise RecoveryError(f"it has other parameters: {difference}")
        restored = restore(saved, run.state)
    except EarthmovingError as error:
        recovery.reject(str(error))
        if run is not None:
            run.close()
        return None
    run.resume(restored.state)
    recovery.resume(saved, f"run {begin.facts.run_id} at tick {run.tick}")
    return ContinuedRun(run, begin, restored.last_ticks)
