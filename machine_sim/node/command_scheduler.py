"""The levers of one machine in one run: when what it is told counts, and whether it waits for it.

Knows no messages' carrier and reads no clock: the caller says what time it is.
"""

from __future__ import annotations

from collections.abc import Callable

from machine_sim.commands import AppliedCommand
from machine_sim.endpoint import MachineEndpoint
from machine_sim.node.machine_instance import MachineInstance
from machine_sim.simulated_machine import SimulatedMachine
from msg_bridge.codec.run_config import RunFacts

__all__ = ["CommandScheduler"]

_MAX_TICKS_AHEAD = 2
"""Ticks by which a command may come ahead, if not by a whole period of waiting."""


class CommandScheduler:
    """Takes the commands of one machine while a run lasts.

    Attributes:
        board: what it is told, which outlives a run.
    """

    def __init__(
        self,
        unit: MachineInstance,
        rig: SimulatedMachine,
        endpoint: MachineEndpoint,
        facts: RunFacts,
    ) -> None:
        """
        Args:
            unit: the machine of the node.
            rig: the same at work in this run.
            side: tells the tick.
            facts: of the run.
        """
        self.arbiter = unit.arbiter
        self._machine, self._endpoint, self._facts = rig.machine, endpoint, facts
        self._wait_period = unit.params.command_wait_period
        self._delay_ticks = 0 if facts.realtime else unit.params.command_delay
        self._last_answered_tick = -1  # newest tick that a stamped command was for
        self._delayed: list[tuple[int, Callable[[], bool]]] = []  # commands, and when they count

    @property
    def sim_time(self) -> float:
        """Simulation time reached [s]."""
        return max(self._endpoint.tick, 0) * self._facts.tick_period

    def command_time(self, wall: float) -> float:
        """The time by which commands grow old [s]: the wall clock's only in real time.

        Args:
            wall: a monotonic wall clock [s].
        """
        return wall if self._facts.realtime else self.sim_time

    def receive(self, stamp: float, deliver: Callable[[], bool]) -> None:
        """Take a command that answers the state of time `stamp` [s]: now, or when it is to count.

        A stamp far ahead, of another clock or of the run before, is no answer to anything.

        Args:
            stamp: of the message.
            deliver: hands it to the board; whether it was good.
        """
        tick, now = round(stamp / self._facts.tick_period), self._endpoint.tick
        answers = tick <= max(now, 0) + max(self._wait_period, _MAX_TICKS_AHEAD)
        if answers and self._delay_ticks and tick + self._delay_ticks > now:
            self._delayed.append((tick + self._delay_ticks, deliver))
        elif not deliver():
            return
        if answers:
            self._last_answered_tick = max(self._last_answered_tick, tick)

    @property
    def has_awaited_command(self) -> bool:
        """Whether the command is there that the next tick waits for, if it waits for one."""
        answered = self._endpoint.tick - self._delay_ticks
        awaits = self._wait_period > 0 and answered >= 0 and answered % self._wait_period == 0
        return self._facts.realtime or not awaits or self._last_answered_tick >= answered

    def apply_command(self, wall: float) -> AppliedCommand:
        """Give the machine what takes effect in the tick that begins now."""
        self._deliver_due()
        applied = self.arbiter.command_at(self.command_time(wall), self._machine.joint_positions)
        self._machine.command(applied.joints, applied.tracks)
        return applied

    def _deliver_due(self) -> None:
        """Hand over the commands whose time has come, in the order of their stamps."""
        now = self._endpoint.tick
        due = [each for each in self._delayed if each[0] <= now]
        self._delayed = [each for each in self._delayed if each[0] > now]
        for _, deliver in sorted(due, key=lambda each: each[0]):
            deliver()
