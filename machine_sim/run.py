"""A run of one machine: what it is told, when it steps, and what is due to be told of it.

Knows no messages' carrier and reads no clock: the caller says what time it is.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from dataclasses import replace

from machine_sim.commands import AppliedCommand, CommandBoard
from machine_sim.core import MachineSim
from machine_sim.machine import MachineDescription
from machine_sim.node_params import MachineNodeParams
from machine_sim.params import MachineSimParams
from machine_sim.particles import ParticleParams
from machine_sim.rig import Placement
from machine_sim.side import MachineSide
from msg_bridge.codec.sim_config import RunFacts
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.messages import Keyframe
from msg_bridge.exchange.machine_side import MachineExchange

__all__ = ["MachineRun", "first_life"]

_CLOCKS_DIFFER = 2**16
"""By how much hosts may disagree on the time [s]."""

_MOST_AHEAD = 2
"""Ticks by which a command may come ahead, if not by a whole period of waiting."""


class MachineRun:
    """One machine in one run of the soil.

    Attributes:
        facts: of the run, as the soil tells them.
        side: the machine and its end of the exchange.
        board: what it is told.
    """

    def __init__(
        self,
        description: MachineDescription,
        params: MachineNodeParams,
        stepping: MachineSimParams,
        particles: ParticleParams,
        board: CommandBoard,
        facts: RunFacts,
        keyframe: Keyframe,
        *,
        life: int,
    ) -> None:
        """
        Args:
            description: the machine.
            params: its place and number.
            stepping, particles: physics; the number of steps in a tick follows from the run's.
            board: commands, which outlive a run.
            facts: of the run.
            keyframe: the terrain it is set down on.
            life: number below 2**32 that no life of this source has had in this run.

        Raises:
            ParameterError: the soil's tick is not a whole number of physics steps.
            MachineError: a place off the map.
        """
        self.facts = facts
        self.board = board
        self._params = params
        self._commanded = -1  # newest tick that a stamped command was for
        self._delay = 0 if facts.realtime else params.command_delay
        self._held: list[tuple[int, Callable[[], bool]]] = []  # commands, and when they count
        sim = MachineSim(
            [Placement(description, (params.x, params.y), math.radians(params.yaw))],
            keyframe.grid,
            keyframe.elevation,
            params=_in_step(stepping, facts),
            particle_params=particles,
            soils=facts.soils,
            soil=keyframe.soil,
            moisture=keyframe.moisture,
            seed=params.seed,
        )
        exchange = MachineExchange(params.source, epoch=facts.epoch, life=life)
        self.side = MachineSide(sim, exchange)

    @property
    def sim(self) -> MachineSim:
        """The machine and its particles."""
        return self.side.sim

    @property
    def tick(self) -> int:
        """The last tick done."""
        return self.side.tick

    @property
    def sim_time(self) -> float:
        """Simulation time reached [s]."""
        return max(self.tick, 0) * self.facts.tick

    def command_time(self, wall: float) -> float:
        """The time by which commands grow old [s]: the wall clock's only in real time.

        Args:
            wall: a monotonic wall clock [s].
        """
        return wall if self.facts.realtime else self.sim_time

    def hear(self, stamp: float, deliver: Callable[[], bool]) -> None:
        """Take a command that answers the state of time `stamp` [s]: now, or when it is to count.

        A stamp far ahead, of another clock or of the run before, is no answer to anything.

        Args:
            stamp: of the message.
            deliver: hands it to the board; whether it was good.
        """
        tick = round(stamp / self.facts.tick)
        answers = tick <= max(self.tick, 0) + max(self._params.await_commands_every, _MOST_AHEAD)
        if answers and self._delay and tick + self._delay > self.tick:
            self._held.append((tick + self._delay, deliver))
        elif not deliver():
            return
        if answers:
            self._commanded = max(self._commanded, tick)

    @property
    def may_step(self) -> bool:
        """Whether the next tick can be done: answers taken, and a command there if awaited."""
        every, answered = self._params.await_commands_every, self.tick - self._delay
        awaits = every > 0 and not self.facts.realtime and answered >= 0 and answered % every == 0
        return self.side.ready and not (awaits and self._commanded < answered)

    def command(self, wall: float) -> AppliedCommand:
        """Give the machine what takes effect in the tick that begins now."""
        self._deliver()
        applied = self.board.at(self.command_time(wall), self.sim.machine.joint_positions)
        self.sim.command(applied.joints, applied.tracks)
        return applied

    def _deliver(self) -> None:
        """Hand over the commands whose time has come, in the order of their stamps."""
        due = [each for each in self._held if each[0] <= self.tick]
        self._held = [each for each in self._held if each[0] > self.tick]
        for _, deliver in sorted(due, key=lambda each: each[0]):
            deliver()

    def due(self, tick: int, rate: float) -> bool:
        """Whether what is told `rate` times a simulated second is due after a tick."""
        if rate <= 0.0:
            return False
        return tick % max(1, round(1.0 / (rate * self.facts.tick))) == 0

    def close(self) -> None:
        """Free what the machine holds."""
        self.sim.close()


def first_life(name: str, epoch: int, now: float) -> int:
    """A life above those that earlier processes of a machine had in a run, and no other machine's.

    Machines that were given the same source by mistake are told apart by it, even if they begin in
    the same instant. In a run of more than 2**22 s (48 days) lives begin from 0 again.

    Args:
        name: of the machine, its namespace.
        epoch: of the run; the soil counts it up from the time at which it was started.
        now: seconds since 1970.
    """
    seconds = (int(now) - epoch + _CLOCKS_DIFFER) % 2**22
    return seconds << 10 | zlib.crc32(name.encode()) % 2**10


def _in_step(stepping: MachineSimParams, facts: RunFacts) -> MachineSimParams:
    """The stepping with as many physics steps as the soil's tick takes."""
    steps = round(facts.tick / stepping.physics_step)
    if steps < 1 or not math.isclose(steps * stepping.physics_step, facts.tick, rel_tol=1e-9):
        raise ParameterError(
            f"the soil's tick is {facts.tick} s, not a whole number of physics steps of"
            f" {stepping.physics_step} s; set stepping.physics_step or the soil's tick to fit"
        )
    return replace(stepping, steps_per_tick=steps)
