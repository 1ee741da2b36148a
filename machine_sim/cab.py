"""The levers of one machine in one run: when what it is told counts, and whether it waits for it.

Knows no messages' carrier and reads no clock: the caller says what time it is.
"""

from __future__ import annotations

from collections.abc import Callable

from machine_sim.commands import AppliedCommand
from machine_sim.side import MachineSide
from machine_sim.unit import Unit
from machine_sim.work.rig import Rig
from msg_bridge.codec.sim_config import RunFacts

__all__ = ["Cab"]

_MOST_AHEAD = 2
"""Ticks by which a command may come ahead, if not by a whole period of waiting."""


class Cab:
    """Takes the commands of one machine while a run lasts.

    Attributes:
        board: what it is told, which outlives a run.
    """

    def __init__(self, unit: Unit, rig: Rig, side: MachineSide, facts: RunFacts) -> None:
        """
        Args:
            unit: the machine of the node.
            rig: the same at work in this run.
            side: tells the tick.
            facts: of the run.
        """
        self.board = unit.board
        self._machine, self._side, self._facts = rig.machine, side, facts
        self._every = unit.params.await_commands_every
        self._delay = 0 if facts.realtime else unit.params.command_delay
        self._commanded = -1  # newest tick that a stamped command was for
        self._held: list[tuple[int, Callable[[], bool]]] = []  # commands, and when they count

    @property
    def sim_time(self) -> float:
        """Simulation time reached [s]."""
        return max(self._side.tick, 0) * self._facts.tick

    def command_time(self, wall: float) -> float:
        """The time by which commands grow old [s]: the wall clock's only in real time.

        Args:
            wall: a monotonic wall clock [s].
        """
        return wall if self._facts.realtime else self.sim_time

    def hear(self, stamp: float, deliver: Callable[[], bool]) -> None:
        """Take a command that answers the state of time `stamp` [s]: now, or when it is to count.

        A stamp far ahead, of another clock or of the run before, is no answer to anything.

        Args:
            stamp: of the message.
            deliver: hands it to the board; whether it was good.
        """
        tick, now = round(stamp / self._facts.tick), self._side.tick
        answers = tick <= max(now, 0) + max(self._every, _MOST_AHEAD)
        if answers and self._delay and tick + self._delay > now:
            self._held.append((tick + self._delay, deliver))
        elif not deliver():
            return
        if answers:
            self._commanded = max(self._commanded, tick)

    @property
    def answered(self) -> bool:
        """Whether the command is there that the next tick waits for, if it waits for one."""
        answered = self._side.tick - self._delay
        awaits = self._every > 0 and answered >= 0 and answered % self._every == 0
        return self._facts.realtime or not awaits or self._commanded >= answered

    def command(self, wall: float) -> AppliedCommand:
        """Give the machine what takes effect in the tick that begins now."""
        self._deliver()
        applied = self.board.at(self.command_time(wall), self._machine.joint_positions)
        self._machine.command(applied.joints, applied.tracks)
        return applied

    def _deliver(self) -> None:
        """Hand over the commands whose time has come, in the order of their stamps."""
        now = self._side.tick
        due = [each for each in self._held if each[0] <= now]
        self._held = [each for each in self._held if each[0] > now]
        for _, deliver in sorted(due, key=lambda each: each[0]):
            deliver()
