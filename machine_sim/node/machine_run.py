"""A run of a node's machines: what they are told, when they step, and what is due to be told.

Knows no messages' carrier and reads no clock: the caller says what time it is.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from dataclasses import replace

from machine_sim.commands import AppliedCommand
from machine_sim.dem import ParticleParams
from machine_sim.endpoint import MachineEndpoint
from machine_sim.node.command_scheduler import CommandScheduler
from machine_sim.node.machine_instance import MachineInstance
from machine_sim.node.params import MachineNodeParams
from machine_sim.params import MachineSimParams
from machine_sim.simulated_bin import BinSpec
from machine_sim.simulation import MachineSim
from msg_bridge.codec.run_config import RunFacts
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.messages import Keyframe
from msg_bridge.exchange.machine_exchange import MachineExchange

__all__ = ["MachineRun", "first_session_id"]

_MAX_CLOCK_DIFFERENCE = 2**16
"""By how much hosts may disagree on the time [s]."""


class MachineRun:
    """The machines of a node in one run of the soil.

    Attributes:
        facts: of the run, as the soil tells them.
        side: the machines and their end of the exchange.
        cabs: their levers, in the order given.
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
    ) -> None:
        """
        Args:
            units: the machines.
            params: their number in the exchange, and seed.
            stepping, particles: physics; the number of steps in a tick follows from the run's.
            facts: of the run.
            keyframe: the terrain they are set down on.
            bins: boxes that stand there to be filled.
            life: number below 2**32 that no life of this source has had in this run.

        Raises:
            ParameterError: the soil's tick is not a whole number of physics steps.
            MachineError: a place off the map.
        """
        self.facts = facts
        sim = MachineSim(
            [unit.placement for unit in instances],
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
        self.endpoint = MachineEndpoint(sim, exchange)
        self.schedulers = [
            CommandScheduler(unit, rig, self.endpoint, facts)
            for unit, rig in zip(instances, sim.simulated_machines, strict=True)
        ]

    @property
    def sim(self) -> MachineSim:
        """The machines and their particles."""
        return self.endpoint.sim

    @property
    def tick(self) -> int:
        """The last tick done."""
        return self.endpoint.tick

    @property
    def can_step(self) -> bool:
        """Whether the next tick can be done: answers taken, and commands there if awaited."""
        return self.endpoint.is_ready and all(cab.has_awaited_command for cab in self.schedulers)

    def apply_commands(self, wall: float) -> list[AppliedCommand]:
        """Give each machine what takes effect in the tick that begins now.

        Args:
            wall: a monotonic wall clock [s].
        """
        return [cab.apply_command(wall) for cab in self.schedulers]

    def is_due(self, tick: int, rate: float) -> bool:
        """Whether what is told `rate` times a simulated second is due after a tick."""
        if rate <= 0.0:
            return False
        return tick % max(1, round(1.0 / (rate * self.facts.tick_period))) == 0

    def close(self) -> None:
        """Free what the machines hold."""
        self.sim.close()


def first_session_id(name: str, run_id: int, now: float) -> int:
    """A life above those that earlier processes of a machine had in a run, and no other machine's.

    Machines that were given the same source by mistake are told apart by it, even if they begin in
    the same instant. In a run of more than 2**22 s (48 days) lives begin from 0 again.

    Args:
        name: of the machine's node, its namespace.
        epoch: of the run; the soil counts it up from the time at which it was started.
        now: seconds since 1970.
    """
    seconds = (int(now) - run_id + _MAX_CLOCK_DIFFERENCE) % 2**22
    return seconds << 10 | zlib.crc32(name.encode()) % 2**10


def _with_steps_per_tick(stepping: MachineSimParams, facts: RunFacts) -> MachineSimParams:
    """The stepping with as many physics steps as the soil's tick takes."""
    steps = round(facts.tick_period / stepping.physics_step)
    if steps < 1 or not math.isclose(
        steps * stepping.physics_step, facts.tick_period, rel_tol=1e-9
    ):
        raise ParameterError(
            f"the soil's tick is {facts.tick_period} s, not a whole number of physics steps of"
            f" {stepping.physics_step} s; set stepping.physics_step or the soil's tick to fit"
        )
    return replace(stepping, steps_per_tick=steps)
