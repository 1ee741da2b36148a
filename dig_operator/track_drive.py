"""TrackDrive: track speeds that drive a machine along straight lines and turn it on the spot."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dig_operator.observation import Observation
from dig_operator.observed_machine import ObservedMachine
from machine_sim.machine import MachineSpec

__all__ = ["Line", "TrackDrive"]

Array = NDArray[np.float64]

_HEADING_GAIN = 1.6
"""Angular speed over heading error [1/s]."""

_LINE_GAIN = 0.6
"""Change of the heading over the distance from the line [rad/m]."""

_MAX_LINE_CORRECTION = 0.5
"""Maximum change of the heading toward the line [rad]."""

_MAX_HEADING_ERROR = 0.35
"""Heading error above which the machine turns on the spot [rad]."""

_TURN_TOLERANCE = 0.035
"""Heading error at which a turn on the spot ends [rad]."""

_ACCELERATION = 0.6
"""Acceleration of the commanded track speeds [m/s^2]."""

_BRAKING = 0.4
"""Deceleration before the end of a line [m/s^2]."""

_MIN_SPEED = 0.15
"""Minimum speed until the end of a line is reached [m/s]."""

_STOPPING_DISTANCE = 0.5
"""Distance in which a machine at full speed stops [m], beside what `_ACCELERATION` needs."""

_MAX_OBSTACLE_HEIGHT = 3.5
"""Height above the base up to which a part of another machine is in the way [m]."""


class Line(NamedTuple):
    """A straight line to drive along.

    Attributes:
        end: its end (x, y) [m], map frame.
        course: its direction [rad], map frame.
        is_reverse: whether to drive it backward.
    """

    end: tuple[float, float]
    course: float
    is_reverse: bool = False

    @classmethod
    def from_to(cls, start: Array, end: tuple[float, float], *, is_reverse: bool = False) -> Line:
        """Return the line from a position to an end, (x, y) [m] each."""
        course = math.atan2(end[1] - float(start[1]), end[0] - float(start[0]))
        return cls(end, course, is_reverse)


class TrackDrive:
    """Drives one machine; keeps the commanded speeds, so that they change gradually."""

    def __init__(self, spec: MachineSpec, *, clearance: float, turn_speed: float) -> None:
        """
        Args:
            spec: the machine.
            clearance: distance to keep from other machines [m].
            turn_speed: maximum angular speed [rad/s].
        """
        self._gauge = spec.tracks.gauge
        self._clearance, self._turn_speed = clearance, turn_speed
        self._speeds = np.zeros(2)
        points = ObservedMachine("", spec, np.zeros(3), np.eye(3), spec.home).points
        self._low: Array = points.min(axis=0)
        self._high: Array = points.max(axis=0)
        self._high[2] = max(self._high[2], _MAX_OBSTACLE_HEIGHT)

    def follow(
        self, observation: Observation, line: Line, speed: float, dt: float
    ) -> tuple[Array, bool]:
        """Return the track speeds [m/s], shape (2,), and whether the end is reached.

        Args:
            observation: pose of the machine.
            line: where to drive.
            speed: maximum speed [m/s].
            dt: time until the next command [s].
        """
        x, y, _ = observation.base_position.tolist()
        c, s = math.cos(line.course), math.sin(line.course)
        remaining = (line.end[0] - x) * c + (line.end[1] - y) * s
        offset = (y - line.end[1]) * c - (x - line.end[0]) * s  # to the left of the line
        correction = math.atan(_LINE_GAIN * offset)
        correction = min(max(correction, -_MAX_LINE_CORRECTION), _MAX_LINE_CORRECTION)
        error = _heading_error(observation, line, -correction)
        if remaining <= 0.02:
            return self._ramp(0.0, 0.0, dt), float(np.abs(self._speeds).max()) < _MIN_SPEED
        if abs(error) > _MAX_HEADING_ERROR:
            return self._ramp(0.0, _HEADING_GAIN * error, dt), False
        forward = max(_MIN_SPEED, min(speed, math.sqrt(2.0 * _BRAKING * remaining)))
        forward *= math.cos(error)
        return self._ramp(
            -forward if line.is_reverse else forward, _HEADING_GAIN * error, dt
        ), False

    def turn(self, observation: Observation, yaw: float, dt: float) -> tuple[Array, bool]:
        """Return the track speeds [m/s] that turn the machine to a heading [rad]; and whether it is
        reached."""
        error = math.remainder(yaw - observation.yaw, 2.0 * math.pi)
        if abs(error) < _TURN_TOLERANCE:
            return self._ramp(0.0, 0.0, dt), float(np.abs(self._speeds).max()) < _MIN_SPEED
        return self._ramp(0.0, _HEADING_GAIN * error, dt), False

    def stop(self, dt: float) -> Array:
        """Return track speeds [m/s] that decrease to zero."""
        return self._ramp(0.0, 0.0, dt)

    def find_obstacle(self, observation: Observation, line: Line | None) -> str:
        """Return the name of a machine that is in the way; empty if there is none.

        Args:
            observation: pose of the machine, and the other machines.
            line: where it drives; None for where it stands and turns.
        """
        low, high = self._low - self._clearance, self._high + self._clearance
        if line is not None and abs(_heading_error(observation, line)) <= _MAX_HEADING_ERROR:
            speed = float(np.abs(self._speeds).max())
            ahead = _STOPPING_DISTANCE + speed * speed / (2.0 * _ACCELERATION)
            if line.is_reverse:
                low[0] -= ahead
            else:
                high[0] += ahead
        for machine in observation.others:
            local = (machine.points - observation.base_position) @ observation.base_rotation
            if bool(((local > low) & (local < high)).all(axis=1).any()):
                return machine.name
        return ""

    def _ramp(self, forward: float, turn_rate: float, dt: float) -> Array:
        """Change the commanded speeds toward those of a motion, and return them."""
        turn_rate = min(max(turn_rate, -self._turn_speed), self._turn_speed)
        half = 0.5 * self._gauge * turn_rate
        target = np.array([forward - half, forward + half])
        change = np.clip(target - self._speeds, -_ACCELERATION * dt, _ACCELERATION * dt)
        self._speeds = self._speeds + change
        return self._speeds.copy()


def _heading_error(observation: Observation, line: Line, correction: float = 0.0) -> float:
    """Return the angle from the present heading to that of a line, with a correction [rad]."""
    heading = line.course + correction + (math.pi if line.is_reverse else 0.0)
    return math.remainder(heading - observation.yaw, 2.0 * math.pi)
