"""Observations for tests of the operator, and a machine that only moves: no ground, no soil."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dig_operator import Command, DigCycle, Observation, OperatorPhase
from dig_operator.bucket_kinematics import BucketKinematics
from machine_sim.machine import EXCAVATOR_JOINTS, rotation_matrix, tool_pose
from msg_bridge.contract.grid import Grid
from support.machine_scenes import excavator

Array = NDArray[np.float64]
Surface = Callable[[Array, Array], Array]

MACHINE = excavator()
ARM = BucketKinematics(MACHINE)

OPEN_ANGLE = 1.5
"""Angle from level beyond which the bucket of a KinematicDig empties [rad]."""


def flat(x: Array, y: Array) -> Array:
    return np.zeros_like(x)


def cone(x0: float, y0: float, height: float, slope_deg: float = 35.0) -> Surface:
    """Return a conical heap on level ground."""
    slope = math.tan(math.radians(slope_deg))
    return lambda x, y: np.maximum(height - slope * np.hypot(x - x0, y - y0), 0.0)


def tilted(*, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> Array:
    """Return the rotation from base to map (3, 3) by intrinsic yaw, pitch and roll [rad].

    Positive pitch is nose down, positive roll left side up.
    """
    half = 0.5 * np.array([roll, pitch, yaw])
    (sr, sp, sy), (cr, cp, cy) = np.sin(half), np.cos(half)
    quaternion = [
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    ]
    return rotation_matrix(quaternion)


def observation(
    joints: ArrayLike = MACHINE.home,
    *,
    surface: Surface = flat,
    position: ArrayLike = (0.0, 0.0, 0.0),
    rotation: Array | None = None,
    fill: float = 0.0,
    time: float = 0.0,
) -> Observation:
    """Return the observation of a machine on a 24 m map with heights surface(x, y) [m]."""
    grid = Grid(121, 121, 0.2)
    x, y = np.meshgrid(grid.x(np.arange(121)), grid.y(np.arange(121)), indexing="ij")
    return Observation(
        time=time,
        joints=np.array(joints, dtype=np.float64),
        base_position=np.array(position, dtype=np.float64),
        base_rotation=np.eye(3) if rotation is None else rotation,
        fill=fill,
        grid=grid,
        elevation=surface(x, y),
    )


def lip(observed: Observation, joints: ArrayLike | None = None) -> Array:
    """Return the middle of the cutting lip [m], map frame, shape (3,)."""
    angles = observed.joints if joints is None else joints
    rotation, pin = tool_pose(MACHINE, observed.base_position, observed.base_rotation, angles)
    return np.asarray(pin + rotation[:, 0] * MACHINE.bucket.tip_radius)


class DigStep(NamedTuple):
    """One tick of a KinematicDig: phase and passes at its start, observation, command, lip [m]."""

    phase: OperatorPhase
    num_passes: int
    observed: Observation
    command: Command
    lip: Array


class KinematicDig:
    """A dig cycle on a machine that follows its commands exactly, over level ground.

    The bucket fills at a constant rate in the dig phase, and empties at a constant rate once it is
    open in the dump phase.
    """

    def __init__(
        self,
        dig_cycle: DigCycle,
        *,
        fills: tuple[float, ...] = (0.9,),
        drag_time: float = 2.0,
        emptying_rate: float = 1.0,
        dt: float = 0.02,
        start_time: float = 0.0,
    ) -> None:
        """
        Args:
            dig_cycle: commands the machine.
            fills: fill of the bucket after each pass; the last holds for all further passes.
            drag_time: time until that fill is reached [s].
            emptying_rate: loss of fill of the open bucket [1/s].
            dt: tick [s].
            start_time: simulation time at the first tick [s].
        """
        self.dig_cycle = dig_cycle
        self.steps: list[DigStep] = []
        self._fills, self._drag_time, self._emptying_rate, self._dt = (
            fills,
            drag_time,
            emptying_rate,
            dt,
        )
        self._joints = np.array(MACHINE.home, dtype=np.float64)
        self._limits = [MACHINE.joints[name] for name in EXCAVATOR_JOINTS]
        self._fill, self._num_passes, self._start_time = 0.0, 0, start_time

    @property
    def phases(self) -> list[OperatorPhase]:
        """Phases in order, once for each time that they began."""
        return [
            step.phase
            for previous, step in zip([None, *self.steps], self.steps, strict=False)
            if previous is None or previous.phase != step.phase
        ]

    def during(self, phase: str) -> list[DigStep]:
        """Return the steps in a phase."""
        return [step for step in self.steps if step.phase == phase]

    def run(self, cycles: int = 1, timeout: float = 200.0) -> KinematicDig:
        """Run until a number of cycles is reported.

        Raises:
            AssertionError: it takes longer than `timeout` [s] of simulation time.
        """
        while len(self.dig_cycle.reports) < cycles:
            assert len(self.steps) * self._dt < timeout, self.dig_cycle.phase
            self._step()
        return self

    def run_until(self, phase: str, timeout: float = 100.0) -> KinematicDig:
        """Run until a phase begins.

        Raises:
            AssertionError: it takes longer than `timeout` [s] of simulation time.
        """
        while self.dig_cycle.phase != phase:
            assert len(self.steps) * self._dt < timeout, self.dig_cycle.phase
            self._step()
        return self

    def step(self, *, ticks: int) -> None:
        """Run a number of ticks."""
        for _ in range(ticks):
            self._step()

    def _step(self) -> None:
        phase = self.dig_cycle.phase
        if phase == "dig" and (not self.steps or self.steps[-1].phase != "dig"):
            self._num_passes += 1
        time = self._start_time + len(self.steps) * self._dt
        observed = observation(self._joints, fill=self._fill, time=time)
        command = self.dig_cycle.command(observed, self._dt)
        self.steps.append(DigStep(phase, self._num_passes, observed, command, lip(observed)))
        for k, limit in enumerate(self._limits):
            speed = min(max(command.joints[k], -limit.max_velocity), limit.max_velocity)
            self._joints[k] = min(max(self._joints[k] + speed * self._dt, limit.lower), limit.upper)
        self._update_fill(phase)

    def _update_fill(self, phase: OperatorPhase) -> None:
        if phase == "dig":
            target = self._fills[min(self._num_passes, len(self._fills)) - 1]
            self._fill = min(self._fill + target * self._dt / self._drag_time, target)
        is_open = self._joints[1:].sum() < ARM.level_attitude - OPEN_ANGLE
        if phase == "dump" and is_open:
            self._fill = max(self._fill - self._emptying_rate * self._dt, 0.0)
