"""Cutting a face with a road header: sump in at a lower corner, then passes from side to side.

    start -> (sump -> slew -> (rise -> slew) x rows -> lower) x rounds -> back -> done

A pass crosses the face at one height; the next pass is higher by the height that the head cuts.
The load of the head is estimated from its speed: feed (driving, slewing and lifting) slows down in
proportion to the drop of the head's speed.
"""

from __future__ import annotations

import math

import numpy as np

from dig_operator.dig_cycle import CycleReport
from dig_operator.face_geometry import FaceGeometry
from dig_operator.face_params import FaceCuttingParams
from dig_operator.observation import Command, Observation
from dig_operator.phases import OperatorPhase
from machine_sim.machine.spec import MachineSpec

__all__ = ["FaceCuttingTask"]

_JOINT_TOLERANCE = 0.02
"""Maximum error of a joint that has reached its target [rad]."""

_POSITION_GAIN = 3.0
"""Joint velocity over joint error [1/s]."""

_UNLOADED_SPEED_FRACTION = 0.9
"""Fraction of the commanded head speed above which the feed is not reduced."""

_STALL_SPEED_FRACTION = 0.4
"""Fraction of the commanded head speed below which the feed stops."""

_HEAD_SPEED_FILTER_TIME = 0.1
"""Time constant of the low-pass filter of the head's speed [s]."""

_FREE_SLEW_FACTOR = 2.0
"""Speed of the boom outside the face, as a multiple of `slew_speed`."""

_RETREAT_ADVANCES = 2.0
"""Distance driven back at the end, as a multiple of `advance`."""


class FaceCuttingTask:
    """Operator of a road header that cuts a face.

    Attributes:
        phase: `START`, `SUMP`, `SLEW`, `RISE`, `LOWER`, `BACK` or `DONE`.
        cycle: number of the round, from 1.
        reports: empty, since a round carries no soil.
        abort_reason: why the task was aborted; empty if it was not.
    """

    def __init__(self, machine: MachineSpec, params: FaceCuttingParams) -> None:
        """
        Args:
            machine: the road header.
            params: the face.

        Raises:
            MachineError: the machine has other joints or no drum, or the face is out of reach.
        """
        self._params = params
        self._geometry = FaceGeometry(machine, params)
        self.phase, self.cycle, self.abort_reason = OperatorPhase.START, 1, ""
        self.reports: list[CycleReport] = []
        self._row_index, self._slew_direction = 0, 1.0
        self._start_time: float | None = None
        self._phase_start_position = np.zeros(3)
        self._contact_distance: float | None = None  # driven until the head met the face [m]
        self._last_head_angle: float | None = None
        self._head_angular_velocity = 0.0

    @property
    def done(self) -> bool:
        """Whether the task has ended."""
        return self.phase is OperatorPhase.DONE

    def command(self, observation: Observation, dt: float) -> Command:
        """Return the command for the next `dt` [s]; zero velocities once the task has ended.

        Args:
            observation: its joints are turn, lift and head.
            dt: time since the previous observation and until the next [s].
        """
        if self._start_time is None:
            self._start_time = observation.time
            self._phase_start_position = observation.base_position.copy()
        if observation.time - self._start_time > self._params.timeout:
            self.abort(f"the face was not cut within {self._params.timeout:g} s")
        self._update_head_speed(observation, dt)
        turn, lift = float(observation.joints[0]), float(observation.joints[1])
        speed = self._advance_phase(observation, turn, lift)
        head_angular_velocity = 0.0 if self.done else self._params.head_angular_velocity
        return Command(
            np.array([*self._boom_velocities(turn, lift), head_angular_velocity]),
            np.array([speed, speed], dtype=np.float64),
        )

    def _advance_phase(self, observation: Observation, turn: float, lift: float) -> float:
        """Change the phase if its end is reached; return the speed of the tracks [m/s]."""
        phase = self.phase
        if phase is OperatorPhase.SUMP:
            return self._sump(observation)
        if phase is OperatorPhase.BACK:
            max_distance = _RETREAT_ADVANCES * self._params.advance
            if self._distance_driven(observation) < -max_distance:
                self.phase = OperatorPhase.DONE
            return -self._params.sumping_speed
        if phase is OperatorPhase.START:
            if self._is_at_target(turn, lift) and self._is_head_up_to_speed:
                self._start_phase(OperatorPhase.SUMP, observation)
        elif phase is OperatorPhase.SLEW:
            target = self._slew_direction * self._geometry.max_turn_angle
            if abs(turn - target) < _JOINT_TOLERANCE:
                self._finish_row()
        elif phase is OperatorPhase.RISE:
            if self._is_at_target(turn, lift):
                self._slew_direction = -self._slew_direction
                self.phase = OperatorPhase.SLEW
        elif phase is OperatorPhase.LOWER and self._is_at_target(turn, lift):
            self._finish_round(observation)
        return 0.0

    def _sump(self, observation: Observation) -> float:
        """Drive into the face; return the speed of the tracks [m/s]."""
        distance, feed_factor = self._distance_driven(observation), self._feed_factor
        if self._contact_distance is None and feed_factor < 1.0:
            self._contact_distance = distance
        if self._contact_distance is None and distance > self._params.max_approach_distance:
            self.abort(f"there is no face within {self._params.max_approach_distance:g} m")
            return 0.0
        if (
            self._contact_distance is not None
            and distance >= self._contact_distance + self._params.advance
        ):
            self._slew_direction = -self._slew_direction
            self.phase = OperatorPhase.SLEW
            return 0.0
        return self._params.sumping_speed * feed_factor

    def _finish_row(self) -> None:
        self._row_index += 1
        if self._row_index < len(self._geometry.row_heights):
            self.phase = OperatorPhase.RISE
        else:
            self.phase = OperatorPhase.LOWER
            self._row_index = 0

    def _finish_round(self, observation: Observation) -> None:
        if self.cycle < self._params.rounds:
            self.cycle += 1
            self._start_phase(OperatorPhase.SUMP, observation)
            self._contact_distance = 0.0
        else:
            self._start_phase(OperatorPhase.BACK, observation)

    def _start_phase(self, phase: OperatorPhase, observation: Observation) -> None:
        self.phase = phase
        self._phase_start_position = observation.base_position.copy()

    def abort(self, reason: str) -> None:
        """End the task at once, unless it has ended.

        Args:
            reason: why, for the user.
        """
        if not self.done:
            self.phase, self.abort_reason = OperatorPhase.DONE, reason

    def _distance_driven(self, observation: Observation) -> float:
        """Return the distance driven forward since the phase began [m]."""
        return float(
            (observation.base_position - self._phase_start_position)
            @ observation.base_rotation[:, 0]
        )

    def _update_head_speed(self, observation: Observation, dt: float) -> None:
        """Estimate the angular velocity of the head [rad/s] from the change of its angle."""
        angle = float(observation.joints[2])
        if self._last_head_angle is not None and dt > 0.0:
            rotation = math.remainder(angle - self._last_head_angle, 2.0 * math.pi)
            self._head_angular_velocity += min(1.0, dt / _HEAD_SPEED_FILTER_TIME) * (
                rotation / dt - self._head_angular_velocity
            )
        self._last_head_angle = angle

    @property
    def _is_head_up_to_speed(self) -> bool:
        min_speed = _UNLOADED_SPEED_FRACTION * self._params.head_angular_velocity
        return self._head_angular_velocity > min_speed

    @property
    def _feed_factor(self) -> float:
        """Factor of the feed speed by the load of the head: 1 unloaded, 0 close to a stall."""
        speed_fraction = self._head_angular_velocity / self._params.head_angular_velocity
        range_ = _UNLOADED_SPEED_FRACTION - _STALL_SPEED_FRACTION
        return min(max((speed_fraction - _STALL_SPEED_FRACTION) / range_, 0.0), 1.0)

    def _target(self) -> tuple[float, float]:
        """Return the angles of turn and lift at the end of the phase [rad]."""
        geometry = self._geometry
        height = geometry.row_heights[self._row_index]
        return self._slew_direction * geometry.max_turn_angle, geometry.lift_angle(height)

    def _is_at_target(self, turn: float, lift: float) -> bool:
        target_turn, target_lift = self._target()
        return (
            abs(turn - target_turn) < _JOINT_TOLERANCE
            and abs(lift - target_lift) < _JOINT_TOLERANCE
        )

    def _boom_velocities(self, turn: float, lift: float) -> tuple[float, float]:
        """Return the velocities of turn and lift [rad/s]."""
        if self.phase in (OperatorPhase.DONE, OperatorPhase.BACK):
            return 0.0, 0.0
        target_turn, target_lift = self._target()
        is_free = self.phase in (OperatorPhase.START, OperatorPhase.LOWER)
        max_speed = self._params.slew_speed * (_FREE_SLEW_FACTOR if is_free else self._feed_factor)

        def velocity(error: float) -> float:
            return min(max(_POSITION_GAIN * error, -max_speed), max_speed)

        return velocity(target_turn - turn), velocity(target_lift - lift)
