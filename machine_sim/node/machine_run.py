"""The machines of a node in one run: their commands, when they step, which publications are due.

Independent of the transport and of clocks: the caller passes the time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from machine_sim.commands import AppliedCommand
from machine_sim.dem import ParticleParams
from machine_sim.endpoint import MachineEndpoint
from machine_sim.node.command_scheduler import CommandScheduler
from machine_sim.node.machine_instance import MachineInstance
from machine_sim.node.machine_journal import MachineJournal, MachineRunState
from machine_sim.node.params import MachineNodeParams
from machine_sim.node.reported_motion import TickProgress
from machine_sim.params import MAX_STEPS_PER_TICK, MachineSimParams
from machine_sim.simulated_bin import BinSpec
from machine_sim.simulation import MachineSim
from machine_sim.tick_record import ArbiterStates
from msg_bridge.codec.run_config import RunFacts
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.messages import Keyframe
from msg_bridge.exchange.machine_exchange import MachineExchange

__all__ = ["AwaitedCommand", "MachineRun"]


class AwaitedCommand(NamedTuple):
    """A command that the next tick waits for.

    Attributes:
        stamp: its minimum stamp [s].
        last_stamp: stamp of the last command that arrived [s]; None without one.
    """

    stamp: float
    last_stamp: float | None


class MachineRun:
    """The machines of a node in one run of the soil.

    Attributes:
        facts: parameters of the run, from the soil.
        journal: where the inputs of the run are recorded.
        endpoint: the machines and their end of the exchange.
        schedulers: command scheduler of each machine, in the order given.
        terrain_revision: revision of the terrain on which the machines were placed.
        progress: number of ticks performed, and of ticks of simulation time that passed in the
            sessions of the node; greater by the skipped ones with `overload: skip_ticks`.
    """

    def __init__(
        self,
        instances: Sequence[MachineInstance],
        params: MachineNodeParams,
        stepping: MachineSimParams,
        particles: ParticleParams,
        facts: RunFacts,
        keyframe: Keyframe,
        *,
        bins: Sequence[BinSpec] = (),
        session_id: int,
        journal: MachineJournal | None = None,
    ) -> None:
        """
        Args:
            instances: the machines.
            params: machine id and seed of the node.
            stepping, particles: physics; the number of steps per tick follows from the tick period.
            facts: parameters of the run.
            keyframe: initial terrain.
            bins: bins on the terrain.
            session_id: as for `MachineExchange`.
            journal: where the inputs of the run are recorded.

        Raises:
            ParameterError: the tick period is not a multiple of the physics step.
            MachineError: a position off the map, or overlapping machines.
        """
        self.facts = facts
        self.journal = journal or MachineJournal(None)
        self.progress = TickProgress(0, 0)
        self._last_interval = 1  # ticks of simulation time in which the last tick was made
        self._instances = tuple(instances)
        self.terrain_revision = keyframe.revision
        sim = MachineSim(
            [instance.placement for instance in instances],
            keyframe.grid,
            keyframe.elevation,
            params=_with_steps_per_tick(stepping, facts),
            particle_params=particles,
            soils=facts.soils,
            soil=keyframe.soil,
            moisture=keyframe.moisture,
            bins=bins,
            seed=params.seed,
        )
        exchange = MachineExchange(params.machine_id, run_id=facts.run_id, session_id=session_id)
        self._has_discarded_soil = False  # since the last request to join
        self._set_endpoint(MachineEndpoint(sim, exchange))

    def _set_endpoint(self, endpoint: MachineEndpoint) -> None:
        self.endpoint = endpoint
        simulated_machines = endpoint.sim.simulated_machines
        self.schedulers = [
            CommandScheduler(instance, simulated, endpoint, self.facts)
            for instance, simulated in zip(self._instances, simulated_machines, strict=True)
        ]

    def resume(self, state: MachineRunState) -> None:
        """Continue from a state of the run, in the physics client of its bodies."""
        self._set_endpoint(state.endpoint)
        self.progress = state.progress
        for instance, arbiter in zip(self._instances, state.arbiters, strict=True):
            instance.arbiter.restore(arbiter)
        for scheduler in self.schedulers:
            scheduler.resume()

    def continue_from(self, other: MachineRun) -> None:
        """Continue the run of machines that may have other parameters; see `MachineSim`.

        Raises:
            MachineError, ParticleError: see `MachineSim.continue_from`.
        """
        sim, endpoint = self.sim, other.endpoint
        sim.continue_from(endpoint.sim)
        endpoint.sim = sim
        self._set_endpoint(endpoint)
        self.terrain_revision = other.terrain_revision
        self.progress, self._last_interval = other.progress, other._last_interval

    @property
    def state(self) -> MachineRunState:
        """Present state of the run, without physics."""
        client_id = self.sim.machine.client_id
        return MachineRunState(self.endpoint, self.progress, self._arbiters, client_id)

    @property
    def _arbiters(self) -> ArbiterStates:
        """What the machines have received; in real time without commands, which time out by the
        wall clock of the process."""
        states = [each.arbiter.state for each in self._instances]
        if self.facts.realtime:
            states = [each.without_timed() for each in states]
        return tuple(states)

    def record_arbiters(self) -> None:
        """Record between two ticks what the machines have received, if it has changed."""
        self.journal.record_arbiters(self._arbiters)

    @property
    def sim(self) -> MachineSim:
        """The simulation of machines and particles."""
        return self.endpoint.sim

    @property
    def tick(self) -> int:
        """Number of the last completed tick."""
        return self.endpoint.tick

    @property
    def can_step(self) -> bool:
        """Whether the next tick can be performed: answers and awaited commands have arrived."""
        return self.endpoint.is_ready and all(
            scheduler.awaited_stamp is None for scheduler in self.schedulers
        )

    def needs_map(self, run_id: int) -> bool:
        """Return whether the terrain of a run is needed: of another run, or to join this one."""
        return run_id != self.facts.run_id or not self.endpoint.exchange.joined

    @property
    def awaited_commands(self) -> dict[str, AwaitedCommand]:
        """The commands that have not arrived yet, by machine."""
        return {
            instance.name or instance.spec.name: AwaitedCommand(stamp, scheduler.last_stamp)
            for instance, scheduler in zip(self._instances, self.schedulers, strict=True)
            if (stamp := scheduler.awaited_stamp) is not None
        }

    @property
    def unanswered_ticks(self) -> frozenset[int]:
        """Ticks before a restart of the node whose answers were lost and are awaited."""
        return frozenset().union(*(each.unanswered_ticks for each in self.schedulers))

    def accept_later_answers(self) -> None:
        """See `CommandScheduler.accept_later_answers`."""
        for scheduler in self.schedulers:
            scheduler.accept_later_answers()

    @property
    def num_delayed_states(self) -> int:
        """Number of the last states whose answers have not taken effect yet."""
        return max(scheduler.num_delayed_states for scheduler in self.schedulers)

    def join(self) -> None:
        """Request to join the run with the soil that the machines hold.

        Raises:
            ExchangeError: the machines take part already.
        """
        self.journal.record_join(discards_soil=self._has_discarded_soil)
        self._has_discarded_soil = False
        self.endpoint.join()

    def discard_soil(self) -> int:
        """Remove all soil that the machines hold, to join without; return it [mm^3]."""
        self._has_discarded_soil = True
        return self.endpoint.discard_soil()

    def apply_commands(self, wall: float, *, leave: bool = False) -> list[AppliedCommand]:
        """Apply to each machine the command that takes effect in the tick that begins now.

        What the tick is computed from is in the journal when this returns.

        Args:
            wall: a monotonic wall clock [s].
            leave: as for the `step` that follows.
        """
        commands = [scheduler.apply_command(wall) for scheduler in self.schedulers]
        self.journal.record_tick(self.endpoint, commands, self._arbiters, leave=leave)
        return commands

    def checkpoint_if_due(self) -> None:
        """Write a checkpoint, if it is time for one; call it when what was computed is sent."""
        is_answered = all(scheduler.has_answers for scheduler in self.schedulers)
        self.journal.checkpoint_if_due(self._recorded_state, is_preferred=is_answered)

    def _recorded_state(self) -> MachineRunState:
        """Return the present state, whose commands are the last ones that are recorded."""
        self.record_arbiters()
        return self.state

    def step(self, *, leave: bool = False) -> None:
        """Perform the next tick and send it.

        Args:
            leave: leave the run after it.
        """
        self._last_interval = self.endpoint.next_tick - self.endpoint.tick
        self.endpoint.step(leave=leave)
        self.progress = self.progress.after_tick(self._last_interval)

    def is_due(self, tick: int, rate: float) -> bool:
        """Return whether a publication with a rate [Hz of simulated time] is due after a tick.

        One that was due at a skipped tick is due at the tick after it.
        """
        if rate <= 0.0:
            return False
        period = max(1, round(1.0 / (rate * self.facts.tick_period)))
        return tick % period < self._last_interval

    def close(self) -> None:
        """Release the physics engine."""
        self.sim.close()


def _with_steps_per_tick(stepping: MachineSimParams, facts: RunFacts) -> MachineSimParams:
    """Return the stepping with the number of physics steps of the soil's tick period."""
    steps = round(facts.tick_period / stepping.physics_step)
    if steps < 1 or not math.isclose(
        steps * stepping.physics_step, facts.tick_period, rel_tol=1e-9
    ):
        raise ParameterError(
            f"the tick period of the soil is {facts.tick_period} s, not a multiple of the physics"
            f" step of {stepping.physics_step} s; change stepping.physics_step or tick_period"
        )
    if steps > MAX_STEPS_PER_TICK:
        raise ParameterError(
            f"the tick period of the soil is {facts.tick_period} s, {steps} physics steps of"
            f" {stepping.physics_step} s, and at most {MAX_STEPS_PER_TICK} are possible; increase"
            " stepping.physics_step or reduce tick_period"
        )
    return replace(stepping, steps_per_tick=steps)
