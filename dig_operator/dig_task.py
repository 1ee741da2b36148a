"""A shift: drive up, dig so many bucketfuls, and wait until all soil lies still."""

from __future__ import annotations

import math

import numpy as np

from dig_operator.dig_cycle import CycleReport, DigCycle
from dig_operator.observation import Command, Observation
from dig_operator.params import BehaviourParams, DigTaskParams
from machine_sim.machine.errors import ReachError
from machine_sim.machine.spec import MachineSpec

__all__ = ["DigTask"]

_DRIVE_SPEED = 0.8
"""Of both tracks on the way to the dig [m/s]."""

_BRACE_TIME = 0.5
"""How long the machine stands before it digs [s]: it rocks when it stops."""

_SETTLE_TIME, _MAX_SETTLE_WAIT = 0.1, 3.0
"""Soil that has not moved for this long lies [s]; soil that never does is left at that [s]."""


class DigTask:
    """An operator with a task, from the first glance to the last.

    Attributes:
        phase: what it is doing: `approach`, `brace`, a phase of the dig cycle, `settle`, `done`.
        given_up: why the task was not finished, empty if it was or is not over yet.
    """

    def __init__(
        self, machine: MachineSpec, behaviour: BehaviourParams, task: DigTaskParams
    ) -> None:
        """
        Args:
            machine: what it operates.
            habits: how it works.
            task: what it is to do.
        """
        self.phase = "approach"
        self.abort_reason = ""
        self._machine, self._behaviour, self._task = machine, behaviour, task
        self._initial_observation: Observation | None = None
        self._still_since = 0.0  # when the phase began, or soil last moved
        self._settle_start_time = 0.0
        self._dig_cycle: DigCycle | None = None

    @property
    def cycle(self) -> int:
        """Number of the cycle it is in, from 1; the last one when all are done."""
        number = self._dig_cycle.cycle if self._dig_cycle else 1
        return min(number, self._task.cycles)

    @property
    def reports(self) -> list[CycleReport]:
        """One per finished cycle."""
        return self._dig_cycle.reports if self._dig_cycle else []

    @property
    def done(self) -> bool:
        """Whether it has left the levers."""
        return self.phase == "done"

    def command(self, observation: Observation, dt: float) -> Command:
        """What to do in the next `dt` [s]; holds still once it is done."""
        if self._initial_observation is None:
            self._initial_observation = observation
        if self.phase == "approach" and self._distance_driven(observation) >= self._task.approach:
            self._enter_phase("brace", observation)
        if self.phase == "brace" and observation.time - self._still_since >= _BRACE_TIME:
            self._dig_cycle = DigCycle(
                self._machine,
                self._behaviour,
                dig_azimuth=self._initial_observation.yaw,
                dump_azimuth=self._initial_observation.yaw + math.radians(self._task.dump_angle),
            )
            self.phase = "reach"
        if self.phase not in ("settle", "done") and observation.time > self._task.timeout:
            self._abort(f"{self._task.timeout} s of simulated time were not enough", observation)
        if self.phase == "approach":
            return Command(np.zeros(4), np.full(2, _DRIVE_SPEED))
        if self._dig_cycle is not None and self.phase not in ("settle", "done"):
            return self._dig(self._dig_cycle, observation, dt)
        if self.phase == "settle":
            self._settle(observation)
        return Command(np.zeros(4), np.zeros(2))

    def _dig(self, digger: DigCycle, observation: Observation, dt: float) -> Command:
        if len(digger.reports) >= self._task.cycles:
            self._enter_phase("settle", observation)
            return Command(np.zeros(4), np.zeros(2))
        try:
            command = digger.command(observation, dt)
        except ReachError as error:
            self._abort(str(error), observation)
            return Command(np.zeros(4), np.zeros(2))
        self.phase = digger.phase
        return command

    def _settle(self, observation: Observation) -> None:
        if observation.is_soil_moving:
            self._still_since = observation.time
        quiet = observation.time - self._still_since >= _SETTLE_TIME
        if quiet or observation.time - self._settle_start_time >= _MAX_SETTLE_WAIT:
            self.phase = "done"

    def _distance_driven(self, observation: Observation) -> float:
        assert self._initial_observation is not None
        way = observation.base_position - self._initial_observation.base_position
        return float(np.hypot(way[0], way[1]))

    def _enter_phase(self, phase: str, observation: Observation) -> None:
        self.phase = phase
        self._still_since = self._settle_start_time = observation.time

    def _abort(self, reason: str, observation: Observation) -> None:
        self.abort_reason = reason
        self._enter_phase("settle", observation)
