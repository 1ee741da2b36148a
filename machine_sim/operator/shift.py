"""A shift: drive up, dig so many bucketfuls, and wait until all soil lies still."""

from __future__ import annotations

import math

import numpy as np

from machine_sim.machine.description import MachineDescription
from machine_sim.machine.errors import ReachError
from machine_sim.operator.cycle import CycleReport, DigCycle
from machine_sim.operator.params import OperatorParams, ShiftParams
from machine_sim.operator.view import Command, View

__all__ = ["Shift"]

_DRIVE_SPEED = 0.8
"""Of both tracks on the way to the dig [m/s]."""

_BRACE_TIME = 0.5
"""How long the machine stands before it digs [s]: it rocks when it stops."""

_QUIET_TIME, _LONGEST_WAIT = 0.1, 3.0
"""Soil that has not moved for this long lies [s]; soil that never does is left at that [s]."""


class Shift:
    """An operator with a task, from the first glance to the last.

    Attributes:
        phase: what it is doing: `approach`, `brace`, a phase of the dig cycle, `settle`, `done`.
        given_up: why the task was not finished, empty if it was or is not over yet.
    """

    def __init__(
        self, machine: MachineDescription, habits: OperatorParams, task: ShiftParams
    ) -> None:
        """
        Args:
            machine: what it operates.
            habits: how it works.
            task: what it is to do.
        """
        self.phase = "approach"
        self.given_up = ""
        self._machine, self._habits, self._task = machine, habits, task
        self._start: View | None = None
        self._since = 0.0  # when the phase began, or soil last moved
        self._waited_from = 0.0
        self._digger: DigCycle | None = None

    @property
    def cycle(self) -> int:
        """Number of the cycle it is in, from 1; the last one when all are done."""
        number = self._digger.cycle if self._digger else 1
        return min(number, self._task.cycles)

    @property
    def reports(self) -> list[CycleReport]:
        """One per finished cycle."""
        return self._digger.reports if self._digger else []

    @property
    def done(self) -> bool:
        """Whether it has left the levers."""
        return self.phase == "done"

    def command(self, view: View, dt: float) -> Command:
        """What to do in the next `dt` [s]; holds still once it is done."""
        if self._start is None:
            self._start = view
        if self.phase == "approach" and self._driven(view) >= self._task.approach:
            self._enter("brace", view)
        if self.phase == "brace" and view.time - self._since >= _BRACE_TIME:
            self._digger = DigCycle(
                self._machine,
                self._habits,
                dig_at=self._start.yaw,
                dump_at=self._start.yaw + math.radians(self._task.dump_angle),
            )
            self.phase = "reach"
        if self.phase not in ("settle", "done") and view.time > self._task.longest:
            self._give_up(f"{self._task.longest} s of simulated time were not enough", view)
        if self.phase == "approach":
            return Command(np.zeros(4), np.full(2, _DRIVE_SPEED))
        if self._digger is not None and self.phase not in ("settle", "done"):
            return self._dig(self._digger, view, dt)
        if self.phase == "settle":
            self._settle(view)
        return Command(np.zeros(4), np.zeros(2))

    def _dig(self, digger: DigCycle, view: View, dt: float) -> Command:
        if len(digger.reports) >= self._task.cycles:
            self._enter("settle", view)
            return Command(np.zeros(4), np.zeros(2))
        try:
            command = digger.command(view, dt)
        except ReachError as error:
            self._give_up(str(error), view)
            return Command(np.zeros(4), np.zeros(2))
        self.phase = digger.phase
        return command

    def _settle(self, view: View) -> None:
        if view.moving:
            self._since = view.time
        quiet = view.time - self._since >= _QUIET_TIME
        if quiet or view.time - self._waited_from >= _LONGEST_WAIT:
            self.phase = "done"

    def _driven(self, view: View) -> float:
        assert self._start is not None
        way = view.base_position - self._start.base_position
        return float(np.hypot(way[0], way[1]))

    def _enter(self, phase: str, view: View) -> None:
        self.phase = phase
        self._since = self._waited_from = view.time

    def _give_up(self, reason: str, view: View) -> None:
        self.given_up = reason
        self._enter("settle", view)
