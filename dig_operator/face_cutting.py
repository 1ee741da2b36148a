"""Cutting a face with a road header: sump in at a lower corner, then passes from side to side.

    start -> (sump -> slew -> (rise -> slew) x rows -> lower) x rounds -> back -> done

A pass crosses the face at one height; the next pass is higher by the height that the head cuts.
The load of the head is estimated from its speed. A fully loaded drive loses a few per cent of it;
when it loses more, the head is pressed too hard: feed (driving, slewing and lifting) slows down in
proportion to the drop of the head's speed, and reverses before the head stalls. The face is where
the ground before the head is higher than the floor.
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

_FULL_FEED_SPEED_FRACTION = 0.985
"""Fraction of the commanded head speed above which the feed is not reduced."""

_ZERO_FEED_SPEED_FRACTION = 0.955
"""Fraction of the commanded head speed below which the feed is reversed."""

_MIN_FEED_FACTOR = -0.3
"""Factor of the feed that relieves a head that is close to a stall."""

_FEED_RISE_RATE = 1.5
"""Maximum rate at which the feed factor increases [1/s]: the head meets the face gently."""

_HEAD_SPEED_FILTER_TIME = 0.05
"""Time constant of the low-pass filter of the head's speed [s]."""

_MIN_FACE_HEIGHT = 0.5
"""Minimum mean height of ground that counts as the face, in radii of the head."""

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
        wait_reason: empty, since it waits for nothing.
    """

    wait_reason = ""

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
        self._start_yaw, self._yaw_change = 0.0, 0.0  # [rad]
        self._last_head_angle: float | None = None
        self._head_angular_velocity = 0.0
        self._feed_factor = 0.0  # 1 unloaded, negative near a stall

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
            self._start_yaw = observation.yaw
        self._yaw_change = math.remainder(observation.yaw - self._start_yaw, 2.0 * math.pi)
        if observation.time - self._start_time > self._params.timeout:
            self.abort(f"the face was not cut within {self._params.timeout:g} s")
        self._update_head_speed(observation, dt)
        self._update_feed(dt)
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
            if abs(turn - self._target()[0]) < _JOINT_TOLERANCE:
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
        if self._contact_distance is None and self._is_at_face(observation):
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
        min_speed = _FULL_FEED_SPEED_FRACTION * self._params.head_angular_velocity
        return self._head_angular_velocity > min_speed

    def _is_at_face(self, observation: Observation) -> bool:
        """Return whether the ground before the head is higher than the floor."""
        turn, lift = float(observation.joints[0]), float(observation.joints[1])
        local = self._geometry.points_before_head(turn, lift, 0.5 * observation.grid.cell)
        points = observation.base_position[:2] + local @ observation.base_rotation[:2, :2].T
        heights = observation.surface_heights(points[:, 0], points[:, 1])
        min_height = _MIN_FACE_HEIGHT * self._geometry.drum.radius
        return float(heights.mean() - observation.base_position[2]) > min_height

    def _update_feed(self, dt: float) -> None:
        """Reduce the feed at once with the speed of the head, and increase it slowly."""
        speed_fraction = self._head_angular_velocity / self._params.head_angular_velocity
        range_ = _FULL_FEED_SPEED_FRACTION - _ZERO_FEED_SPEED_FRACTION
        target = (speed_fraction - _ZERO_FEED_SPEED_FRACTION) / range_
        target = min(max(target, _MIN_FEED_FACTOR), 1.0)
        self._feed_factor = min(target, max(self._feed_factor, 0.0) + _FEED_RISE_RATE * dt)

    def _target(self) -> tuple[float, float]:
        """Return the angles of turn and lift at the end of the phase [rad].

        The boom reaches the sides of the face although the machine has turned on its tracks.
        """
        geometry = self._geometry
        height = geometry.row_heights[self._row_index]
        turn = self._slew_direction * geometry.max_turn_angle - self._yaw_change
        return geometry.clip_turn_angle(turn), geometry.lift_angle(height)

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
        speed = self._params.slew_speed * (_FREE_SLEW_FACTOR if is_free else self._feed_factor)

        def velocity(error: float) -> float:
            return math.copysign(1.0, speed) * min(
                max(_POSITION_GAIN * error, -abs(speed)), abs(speed)
            )

        return velocity(target_turn - turn), velocity(target_lift - lift)
