"""DigCycle: the cycle of an excavator's operator: reach, dig, curl, lift, swing, dump.

Each pass is planned from the terrain as it is then. A full bucket ends its drag early, and a bucket
that is not full after a pass digs another one. The volume that the next cycle plans to sweep is
adapted to how full the bucket was.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dig_operator.bucket_kinematics import BucketPose
from dig_operator.cycle_waypoints import Motion, WaypointPlanner
from dig_operator.observation import BaseFilter, Command, Observation
from dig_operator.phases import OperatorPhase

__all__ = ["CycleReport", "DigCycle"]

_NEXT_PHASE = {
    OperatorPhase.REACH: OperatorPhase.DIG,
    OperatorPhase.DIG: OperatorPhase.CURL,
    OperatorPhase.CURL: OperatorPhase.LIFT,
    OperatorPhase.LIFT: OperatorPhase.SWING,
    OperatorPhase.WAIT: OperatorPhase.SWING,
    OperatorPhase.SWING: OperatorPhase.DUMP,
    OperatorPhase.DUMP: OperatorPhase.REACH,
    OperatorPhase.STOW: OperatorPhase.STOW,  # until `resume`
}

_LOADED_PHASES = (OperatorPhase.LIFT, OperatorPhase.WAIT, OperatorPhase.SWING)
"""Phases in which the load may tip the machine over."""

_STANDSTILL, _SPILL_VELOCITIES = (0.0,) * 4, (0.0, 0.0, 0.0, -0.4)
"""Joint velocities that stop all joints, and that spill some of the load [rad/s]."""

_TARGET_PHASES = (OperatorPhase.WAIT, OperatorPhase.SWING, OperatorPhase.DUMP)
"""Phases in which the place to dump at must be ready."""

_PHASES_ENDING_AT_REST = (OperatorPhase.REACH, OperatorPhase.SWING, OperatorPhase.STOW)
"""Phases that end only when the machine is at rest."""

_REST_SPEED = 0.05
"""Commanded joint speed below which the machine counts as at rest [rad/s]."""

_TARGET_FILL_INCREASE, _TARGET_FILL_DECREASE = 1.1, 0.95
"""Factors of the target fill after a cycle with too little and with too much soil."""

_MIN_TARGET_FILL, _MAX_TARGET_FILL = 0.6, 2.0
"""Range of the adapted target fill; a configured value beyond it is kept."""


@dataclass(frozen=True)
class CycleReport:
    """Result of one cycle.

    Attributes:
        number: number of the cycle, from 1.
        num_passes: number of passes.
        planned_volume: volume that the first pass was planned to sweep [m^3].
        carried_fill: fill at the start of the swing, as a fraction of heaped capacity.
        delivered_fill: fill above the dump.
        residual_fill: fill after dumping.
        duration: duration of the cycle [s].
        moved_volume: bank volume dumped [m^3].
    """

    number: int
    num_passes: int
    planned_volume: float
    carried_fill: float
    delivered_fill: float
    residual_fill: float
    duration: float
    moved_volume: float = 0.0


class DigCycle:
    """State machine of the dig cycle of one excavator.

    Attributes:
        params: behaviour of the operator.
        phase: `REACH`, `DIG`, `CURL`, `LIFT`, `WAIT`, `SWING`, `DUMP` or `STOW`.
        cycle: number of the present cycle, from 1.
        reports: one report per finished cycle.
        wait_reason: what it waits for in the phase `WAIT`, for the user; else empty.
        has_dug: whether the bucket has been lowered to the ground in the present cycle.
        is_stowed: whether the bucket has been stowed, so that the machine can drive.
    """

    def __init__(self, planner: WaypointPlanner) -> None:
        """
        Args:
            planner: plans the waypoints of each phase, for one machine, behaviour and dig site.
        """
        self.params = planner.params
        self.phase = OperatorPhase.REACH
        self.cycle = 1
        self.reports: list[CycleReport] = []
        self.wait_reason = ""
        self.has_dug = self.is_stowed = False
        self._planner = planner
        self._plan_motion: dict[OperatorPhase, Callable[[Observation, BucketPose], Motion]] = {
            OperatorPhase.REACH: self._planner.reach,
            OperatorPhase.DIG: self._planner.dig,
            OperatorPhase.CURL: self._planner.curl,
            OperatorPhase.LIFT: self._planner.lift,
            OperatorPhase.SWING: self._planner.swing,
            OperatorPhase.DUMP: self._planner.dump,
            OperatorPhase.STOW: self._planner.stow,
        }
        self._motion: Motion | None = None
        self._base_filter = BaseFilter(self.params.base_filter_time)
        self._joint_velocities = [0.0] * 4
        self._target_fill = self.params.target_fill
        self._dig_base_rotation = np.eye(3)  # at the start of the last drag
        self._cycle_start_time: float | None = None
        self._dump_time = self._spill_time = 0.0  # since the bucket is open [s]
        self._num_passes = 0
        self._planned_volume = 0.0
        self._carried_fill = 0.0
        self._has_arrived = False  # above the dump in this cycle
        self._delivered_fill = 0.0
        self._delivered_volume = 0.0

    def command(self, observation: Observation, dt: float) -> Command:
        """Return the command for the next `dt` [s].

        Raises:
            ReachError: no ground, or no set point, is in reach.
        """
        is_tipping = self._is_tipping(observation)
        observation = self._base_filter.update(observation, dt)
        if self._cycle_start_time is None:
            self._cycle_start_time = observation.time
        self._update_wait(observation)
        if self._motion is None and self.phase is not OperatorPhase.WAIT:
            self._motion = self._start_phase(observation)
        targets = _STANDSTILL
        if is_tipping:
            targets = _SPILL_VELOCITIES
            self._accept_tilt(observation, dt)
        elif self._motion is not None:
            motion = self._motion.advance(observation, self._planner.kinematics, dt)
            targets = tuple(motion.tolist())
        # Floats: the arrays are too small for numpy to pay at every tick.
        self._joint_velocities = [
            velocity + min(max(target - velocity, -acceleration * dt), acceleration * dt)
            for velocity, target, acceleration in zip(
                self._joint_velocities, targets, self.params.max_joint_accelerations, strict=True
            )
        ]
        is_overfull = (
            self.phase is OperatorPhase.DIG and observation.fill > self.params.overfill_threshold
        )
        is_done = self._motion is not None and self._motion.done
        if is_overfull or (is_done and self._is_settled):
            self._end_phase(observation, dt)
        return Command(np.array(self._joint_velocities), np.zeros(2))

    @property
    def plan_fraction(self) -> float | None:
        """Volume of the plan of a cycle's first pass, as a fraction of what the pass should sweep,
        while the bucket moves to where it begins; else None."""
        is_first = self._num_passes == 1 and not self.has_dug and self.phase is OperatorPhase.REACH
        return self._planner.plan_fraction if is_first else None

    def stow(self) -> None:
        """Begin to lift the bucket ahead of the machine instead of digging; call `resume` later."""
        self.phase, self._motion, self.is_stowed = OperatorPhase.STOW, None, False

    def resume(self) -> None:
        """Begin a cycle where the machine stands now."""
        self.has_dug = False
        self.phase, self._motion, self.is_stowed = OperatorPhase.REACH, None, False
        self._num_passes, self._cycle_start_time = 0, None
        self._joint_velocities = [0.0] * 4
        self._base_filter = BaseFilter(self.params.base_filter_time)

    def _is_tipping(self, observation: Observation) -> bool:
        """Return whether the load pitches the machine forward too far, compared with the dig."""
        if self.phase not in _LOADED_PHASES or observation.fill <= self.params.empty_threshold:
            return False
        nose_up_angle = self._planner.kinematics.nose_up_angle
        as_when_digging = observation.with_base(observation.base_position, self._dig_base_rotation)
        return nose_up_angle(observation) < nose_up_angle(as_when_digging) - self.params.max_pitch

    def _accept_tilt(self, observation: Observation, dt: float) -> None:
        """Compare with the present tilt once an open bucket spills no more.

        What is left of the load sticks, and the machine tilts because the ground yields.
        """
        is_open = self._planner.kinematics.is_bucket_open(observation)
        self._spill_time = self._spill_time + dt if is_open else 0.0
        if self._spill_time >= self.params.dump_timeout:
            self._dig_base_rotation, self._spill_time = observation.base_rotation, 0.0

    def _update_wait(self, observation: Observation) -> None:
        """Stop before a target that is not ready, and continue once it is."""
        self._planner.dump_target.watch(observation)
        is_empty = observation.fill <= self.params.empty_threshold
        if self.phase not in _TARGET_PHASES or (self.phase is OperatorPhase.DUMP and is_empty):
            return
        is_swinging = self.phase is not OperatorPhase.WAIT
        self.wait_reason = self._planner.dump_target.find_obstacle(
            observation, is_swinging=is_swinging or self._has_arrived
        )
        if self.wait_reason and is_swinging:
            self.phase, self._motion = OperatorPhase.WAIT, None
        elif not self.wait_reason and not is_swinging and self._is_at_rest:
            self.phase = OperatorPhase.SWING

    @property
    def _is_at_rest(self) -> bool:
        """Whether the commanded speeds are small."""
        return max(map(abs, self._joint_velocities)) < _REST_SPEED

    @property
    def _is_settled(self) -> bool:
        """Whether the machine is at rest, if the phase ends only then."""
        return self.phase not in _PHASES_ENDING_AT_REST or self._is_at_rest

    def _start_phase(self, observation: Observation) -> Motion:
        pose = self._planner.kinematics.bucket_pose(observation)
        if self.phase is OperatorPhase.REACH:
            is_first = self._num_passes == 0
            self._planner.plan_pass(observation, self._target_fill, is_first=is_first)
            if is_first:
                self._planned_volume = self._planner.plan.volume
            self._num_passes += 1
        elif self.phase is OperatorPhase.DIG:
            self._dig_base_rotation, self.has_dug = observation.base_rotation, True
        return self._plan_motion[self.phase](observation, pose)

    def _end_phase(self, observation: Observation, dt: float) -> None:
        next_phase = _NEXT_PHASE[self.phase]
        if self.phase is OperatorPhase.LIFT:
            if self._needs_another_pass(observation):
                next_phase = OperatorPhase.REACH
            else:
                self._carried_fill = observation.fill
                obstacle = self._planner.dump_target.find_obstacle(observation, is_swinging=False)
                next_phase = OperatorPhase.WAIT if obstacle else OperatorPhase.SWING
        elif self.phase is OperatorPhase.STOW:
            self.is_stowed = True
            return
        elif self.phase is OperatorPhase.SWING:
            if not self._has_arrived:  # a dump that was interrupted began with more
                self._delivered_fill = observation.fill
                self._delivered_volume = observation.bank_m3
            self._has_arrived = True
            self._dump_time = 0.0
        elif self.phase is OperatorPhase.DUMP:
            self._dump_time += dt if self._is_at_rest else 0.0
            is_empty = observation.fill <= self.params.empty_threshold
            if not is_empty and self._dump_time < self.params.dump_timeout:
                return
            self._finish_cycle(observation)
        self.phase = next_phase
        self._motion = None

    def _needs_another_pass(self, observation: Observation) -> bool:
        return observation.fill < self.params.min_fill and self._num_passes < self.params.max_passes

    def _finish_cycle(self, observation: Observation) -> None:
        self._planner.dump_target.count_dump(observation)
        assert self._cycle_start_time is not None, "a cycle that ends has begun"
        self.reports.append(
            CycleReport(
                number=self.cycle,
                num_passes=self._num_passes,
                planned_volume=self._planned_volume,
                carried_fill=self._carried_fill,
                delivered_fill=self._delivered_fill,
                residual_fill=observation.fill,
                duration=observation.time - self._cycle_start_time,
                moved_volume=self._delivered_volume - observation.bank_m3,
            )
        )
        self._adapt_target_fill()
        self._has_arrived = self.has_dug = False
        self.cycle += 1
        self._num_passes = 0
        self._cycle_start_time = observation.time

    def _adapt_target_fill(self) -> None:
        """Plan more soil after a bucket that was not full, less after one that overflowed."""
        fill = self._target_fill
        if self._num_passes > 1 or self._delivered_fill < self.params.min_fill:
            self._target_fill = min(fill * _TARGET_FILL_INCREASE, max(fill, _MAX_TARGET_FILL))
        elif self._carried_fill > self.params.overfill_threshold:
            self._target_fill = max(fill * _TARGET_FILL_DECREASE, min(fill, _MIN_TARGET_FILL))
