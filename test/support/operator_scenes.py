"""What an operator is shown in tests, and a machine that only moves: no ground, no soil."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dig_operator import Command, DigCycle, Observation
from dig_operator.bucket_kinematics import BucketKinematics
from machine_sim.machine import EXCAVATOR_JOINTS, rotation_matrix, tool_pose
from msg_bridge.contract.grid import Grid
from support.machine_scenes import excavator

Array = NDArray[np.float64]
Surface = Callable[[Array, Array], Array]

MACHINE = excavator()
ARM = BucketKinematics(MACHINE)


def flat(x: Array, y: Array) -> Array:
    return np.zeros_like(x)


def cone(x0: float, y0: float, height: float, slope_deg: float = 35.0) -> Surface:
    """A heap on level ground, as steep as poured soil stands."""
    slope = math.tan(math.radians(slope_deg))
    return lambda x, y: np.maximum(height - slope * np.hypot(x - x0, y - y0), 0.0)


def tilted(*, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> Array:
    """Rotation base to map (3, 3): turned by yaw, then nose-down by pitch, then left-up by roll."""
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
    """What is seen from a machine on a 24 m map with heights surface(x, y) [m]."""
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


def lip(seen: Observation, joints: ArrayLike | None = None) -> Array:
    """Where the middle of the cutting lip is [m], map frame, shape (3,)."""
    at = seen.joints if joints is None else joints
    rotation, pin = tool_pose(MACHINE, seen.base_position, seen.base_rotation, at)
    return np.asarray(pin + rotation[:, 0] * MACHINE.bucket.tip_radius)


class DigStep(NamedTuple):
    """What was seen and done in one tick."""

    phase: str
    num_passes: int
    seen: Observation
    command: Command
    lip: Array


class KinematicDig:
    """An operator on a machine that does what it is told, at once, over level ground.

    The bucket fills evenly while it drags, and empties evenly once it stands open.
    """

    def __init__(
        self,
        operator: DigCycle,
        *,
        fills: tuple[float, ...] = (0.9,),
        drag_time: float = 2.0,
        emptying: float = 1.0,
        dt: float = 0.02,
        start_time: float = 0.0,
    ) -> None:
        """
        Args:
            operator: who works the levers.
            fills: what the bucket holds after each pass; the last for all that follow.
            drag_time: until it does [s].
            emptying: fill that leaves the open bucket in a second.
            dt: tick [s].
            start_time: simulation time at the first tick [s].
        """
        self.operator = operator
        self.moments: list[DigStep] = []
        self._fills, self._drag_time, self._emptying, self._dt = fills, drag_time, emptying, dt
        self._ground = observation()
        self._joints = np.array(MACHINE.home, dtype=np.float64)
        self._limits = [MACHINE.joints[name] for name in EXCAVATOR_JOINTS]
        self._fill, self._passes, self._start = 0.0, 0, start_time

    @property
    def phases(self) -> list[str]:
        """Phases in order, each as often as it was begun."""
        return [
            now.phase
            for before, now in zip([None, *self.moments], self.moments, strict=False)
            if before is None or before.phase != now.phase
        ]

    def during(self, phase: str) -> list[DigStep]:
        return [moment for moment in self.moments if moment.phase == phase]

    def run(self, cycles: int = 1, timeout: float = 200.0) -> KinematicDig:
        """Until so many cycles are reported.

        Raises:
            AssertionError: it took longer than `longest` [s] of simulated time.
        """
        while len(self.operator.reports) < cycles:
            assert len(self.moments) * self._dt < timeout, self.operator.phase
            self._tick()
        return self

    def run_until(self, phase: str, timeout: float = 100.0) -> KinematicDig:
        """Until a phase has begun.

        Raises:
            AssertionError: it took longer than `longest` [s] of simulated time.
        """
        while self.operator.phase != phase:
            assert len(self.moments) * self._dt < timeout, self.operator.phase
            self._tick()
        return self

    def _tick(self) -> None:
        phase = self.operator.phase
        if phase == "dig" and (not self.moments or self.moments[-1].phase != "dig"):
            self._passes += 1
        time = self._start + len(self.moments) * self._dt
        seen = observation(self._joints, fill=self._fill, time=time)
        command = self.operator.command(seen, self._dt)
        self.moments.append(DigStep(phase, self._passes, seen, command, lip(seen)))
        for k, limit in enumerate(self._limits):
            speed = min(max(command.joints[k], -limit.max_velocity), limit.max_velocity)
            self._joints[k] = min(max(self._joints[k] + speed * self._dt, limit.lower), limit.upper)
        self._soil(phase)

    def _soil(self, phase: str) -> None:
        if phase == "dig":
            goal = self._fills[min(self._passes, len(self._fills)) - 1]
            self._fill = min(self._fill + goal * self._dt / self._drag_time, goal)
        opened = self._joints[1:].sum() < ARM.level_attitude - 1.5
        if phase == "dump" and opened:
            self._fill = max(self._fill - self._emptying * self._dt, 0.0)
