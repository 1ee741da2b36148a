"""The scripted operator: dig, lift, swing, dump, return, over and over.

It sees what public topics carry and sends what a person would send. It plans each dig from the
terrain as it is, curls early when the bucket is full, digs again when it has not come out full,
and asks for more or less next time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dig_operator.bucket_kinematics import BucketKinematics, BucketPose
from dig_operator.dig_plan import DigPlan, plan_dig
from dig_operator.observation import BaseFilter, Command, Observation
from dig_operator.params import BehaviourParams
from dig_operator.terrain_survey import TerrainSurvey
from dig_operator.waypoint_follower import Waypoint, WaypointFollower
from machine_sim.machine.spec import MachineSpec

__all__ = ["CycleReport", "DigCycle"]

Array = NDArray[np.float64]

_LOADED_PHASES = ("lift", "swing")
"""Phases in which too much in the bucket may tip the machine over."""

_SPILL_VELOCITY = np.array([0.0, 0.0, 0.0, -0.4])
"""Joint velocities [rad/s] that let some of the load fall."""

_MAX_ATTITUDE_GRADIENT, _MAX_ATTITUDE_SPEED = 1.5, 0.4
"""Most the bucket turns on its way through the soil [rad/m], [rad/s]: levers move slowly."""

_NEXT_PHASE = {"reach": "dig", "dig": "curl", "curl": "lift", "lift": "swing", "swing": "dump"}

_PHASES_ENDING_AT_REST = ("reach", "swing")
_REST_SPEED = 0.05
"""Phases that end with the machine at rest, and the joint speed that counts as rest [rad/s]."""

_MIN_TARGET_FILL, _MAX_TARGET_FILL = 0.6, 1.6
"""Appetites it does not learn to go beyond; one it is given may lie beyond them."""


@dataclass(frozen=True)
class CycleReport:
    """How one cycle went.

    Attributes:
        number: from 1.
        passes: drags it took to fill the bucket.
        planned: soil the first pass was to sweep [m^3].
        carried: fill of the bucket when the swing began, in parts of heaped capacity.
        delivered: fill when it stood over the dump.
        left: fill after dumping.
        duration: [s].
        moved: bank volume dumped [m^3].
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
    """An operator at the levers of one excavator.

    Attributes:
        params: its habits.
        phase: what it is doing: `reach`, `dig`, `curl`, `lift`, `swing`, `dump`.
        cycle: number of the cycle, from 1.
        reports: one per finished cycle.
    """

    def __init__(
        self,
        machine: MachineSpec,
        params: BehaviourParams,
        *,
        dig_azimuth: float,
        dump_azimuth: float,
    ) -> None:
        """
        Args:
            machine: what it operates.
            params: its habits.
            dig_at: direction to dig in [rad], map frame.
            dump_at: direction to dump in [rad], map frame.
        """
        self.params = params
        self.phase = "reach"
        self.cycle = 1
        self.reports: list[CycleReport] = []
        self._kinematics = BucketKinematics(machine)
        self._survey = TerrainSurvey(self._kinematics, params, machine.bucket)
        self._capacity = machine.bucket.heaped_capacity
        self._dig_azimuth, self._dump_azimuth = dig_azimuth, dump_azimuth
        self._entry_attitude = self._kinematics.attitude_for_attack_angle(params.entry_angle)
        self._exit_attitude = self._kinematics.attitude_for_attack_angle(params.exit_angle)
        self._target_fill = params.target_fill
        self._base_filter = BaseFilter(params.base_filter_time)
        self._joint_velocities = np.zeros(4)
        self._follower: WaypointFollower | None = None
        self._plan = DigPlan.without_waypoints()
        self._azimuth = dig_azimuth
        self._dig_base_rotation = np.eye(3)  # the base, when the dig began
        self._num_passes = 0
        self._planned_volume = self._carried_fill = self._delivered_fill = (
            self._delivered_volume
        ) = 0.0
        self._cycle_start_time: float | None = None
        self._dump_time = 0.0

    def command(self, observation: Observation, dt: float) -> Command:
        """What to do in the next `dt` [s]."""
        tips = self._is_tipping(observation)
        observation = self._base_filter.update(observation, dt)
        if self._cycle_start_time is None:
            self._cycle_start_time = observation.time
        if self._follower is None:
            self._follower = self._start_phase(observation)
        wanted = (
            _SPILL_VELOCITY if tips else self._follower.advance(observation, self._kinematics, dt)
        )
        most = np.array(self.params.max_joint_accelerations) * dt
        self._joint_velocities = self._joint_velocities + np.minimum(
            np.maximum(wanted - self._joint_velocities, -most), most
        )
        brimful = self.phase == "dig" and observation.fill > self.params.overfill_threshold
        if brimful or (self._follower.done and self._is_settled):
            self._end_phase(observation, dt)
        return Command(self._joint_velocities.copy(), np.zeros(2))

    def _is_tipping(self, observation: Observation) -> bool:
        """Whether what it has in the bucket leans the machine too far from how it stood to dig."""
        if self.phase not in _LOADED_PHASES or observation.fill <= self.params.empty_threshold:
            return False
        stood = replace(observation, base_rotation=self._dig_base_rotation)
        return (
            self._kinematics.nose_up_angle(observation)
            < self._kinematics.nose_up_angle(stood) - self.params.max_pitch
        )

    @property
    def _is_settled(self) -> bool:
        """Whether the machine has come to rest where the next phase needs it at rest."""
        return (
            self.phase not in _PHASES_ENDING_AT_REST
            or float(np.abs(self._joint_velocities).max()) < _REST_SPEED
        )

    # Each phase: how it begins, as a motion, and what comes after it.

    def _start_phase(self, observation: Observation) -> WaypointFollower:
        phases: dict[str, Callable[[Observation, BucketPose], list[Waypoint]]] = {
            "reach": self._reach_waypoints,
            "dig": self._dig_waypoints,
            "curl": self._curl_waypoints,
            "lift": self._lift_waypoints,
            "swing": self._swing_waypoints,
            "dump": self._dump_waypoints,
        }
        here = self._kinematics.bucket_pose(observation)
        return WaypointFollower(here, phases[self.phase](observation, here))

    def _end_phase(self, observation: Observation, dt: float) -> None:
        if self.phase == "dump":
            self._dump_time += dt
            if (
                observation.fill > self.params.empty_threshold
                and self._dump_time < self.params.dump_timeout
            ):
                return
            self._finish_cycle(observation)
            self.phase = "reach"
        elif self.phase == "lift" and self._needs_another_pass(observation):
            self.phase = "reach"
        else:
            if self.phase == "lift":
                self._carried_fill = observation.fill
            elif self.phase == "swing":
                self._delivered_fill, self._delivered_volume = observation.fill, observation.bank
                self._dump_time = 0.0
            self.phase = _NEXT_PHASE[self.phase]
        self._follower = None

    def _needs_another_pass(self, observation: Observation) -> bool:
        return observation.fill < self.params.min_fill and self._num_passes < self.params.max_passes

    def _finish_cycle(self, observation: Observation) -> None:
        assert self._cycle_start_time is not None, "a cycle that ends has begun"
        self.reports.append(
            CycleReport(
                self.cycle,
                self._num_passes,
                self._planned_volume,
                self._carried_fill,
                self._delivered_fill,
                observation.fill,
                observation.time - self._cycle_start_time,
                self._delivered_volume - observation.bank,
            )
        )
        # A bucket that came short, or with so much that it spilled, teaches.
        if self._num_passes > 1 or self._delivered_fill < self.params.min_fill:
            self._target_fill = min(
                self._target_fill * 1.1, max(self._target_fill, _MAX_TARGET_FILL)
            )
        elif self._carried_fill > self.params.overfill_threshold:
            self._target_fill = max(
                self._target_fill * 0.95, min(self._target_fill, _MIN_TARGET_FILL)
            )
        self.cycle += 1
        self._num_passes = 0
        self._cycle_start_time = observation.time

    def _reach_waypoints(self, observation: Observation, here: BucketPose) -> list[Waypoint]:
        """To above the entry of a newly planned dig, and down to it."""
        if self._num_passes == 0:
            self._azimuth = self._survey.highest_ground_azimuth(observation, self._dig_azimuth)
        wanted = self._capacity * self._target_fill  # what is in it falls out where it goes in
        reach = self._survey.dig_reach(observation, self._azimuth, self._entry_attitude)
        self._plan = plan_dig(
            *self._survey.surface_profile(observation, self._azimuth), reach, wanted
        )
        if self._num_passes == 0:
            self._planned_volume = self._plan.volume
        self._num_passes += 1
        r, z = float(self._plan.radius[0]), float(self._plan.height[0])
        slant = float(self._attitudes()[0])
        above = self._kinematics.pose_with_lip_at(
            self._azimuth, r, z + self.params.clearance, slant
        )
        entry = self._kinematics.pose_with_lip_at(self._azimuth, r, z + 0.05, slant)
        return self._timed_waypoints(
            here, [*self._transfer_poses(observation, here, above), above, entry]
        )

    def _dig_waypoints(self, observation: Observation, here: BucketPose) -> list[Waypoint]:
        """Along the plan."""
        self._dig_base_rotation = observation.base_rotation
        plan, slants = self._plan, self._attitudes()
        places = [
            self._kinematics.pose_with_lip_at(self._azimuth, r, z, a)
            for r, z, a in zip(plan.radius, plan.height, slants, strict=True)
        ]
        way = np.hypot(np.diff(plan.radius), np.diff(plan.height)) / self.params.dig_speed
        turn = np.abs(np.diff(slants)) / _MAX_ATTITUDE_SPEED
        durations = [0.3, *np.maximum(way, turn)]
        return [Waypoint(p, float(t)) for p, t in zip(places, durations, strict=True)]

    def _attitudes(self) -> Array:
        """Attitudes of the bucket along the plan [rad].

        Flatter and flatter, but never so flat that its floor drags over the ground behind the lip.
        """
        plan = self._plan
        slants = np.linspace(self._entry_attitude, self._exit_attitude, plan.radius.size)
        dips = np.arctan(np.gradient(plan.height, plan.radius))  # inward: down is positive
        dragging = [
            self._kinematics.attitude_for_attack_angle(dip + self.params.relief_angle)
            for dip in dips
        ]
        slants = np.minimum(slants, dragging)
        # Where the way bends the floor slants more than it must: a bucket turns slowly.
        apart = np.abs(plan.radius[:, None] - plan.radius)
        return np.asarray((slants + _MAX_ATTITUDE_GRADIENT * apart).min(axis=1))

    def _curl_waypoints(self, observation: Observation, here: BucketPose) -> list[Waypoint]:
        """Turn the mouth up while the lip comes out of the soil."""
        up = self.params.curl_lift
        return self._timed_waypoints(
            here,
            [
                here._replace(
                    height=here.height + part * up,
                    attitude=here.attitude
                    + part * (self._kinematics.level_attitude - here.attitude),
                )
                for part in (0.25, 0.5, 0.75, 1.0)
            ],
        )

    def _lift_waypoints(self, observation: Observation, here: BucketPose) -> list[Waypoint]:
        """Straight up, level, to the height of the swing."""
        height = self._survey.swing_clearance_height(observation, here.azimuth, self._dump_azimuth)
        level_attitude = self._kinematics.level_attitude
        return self._timed_waypoints(
            here, [here._replace(height=max(height, here.height), attitude=level_attitude)]
        )

    def _swing_waypoints(self, observation: Observation, here: BucketPose) -> list[Waypoint]:
        """Around to the dump, level, and up to where the open bucket clears the heap."""
        turn = math.remainder(self._dump_azimuth - here.azimuth, 2 * math.pi)
        over = BucketPose(
            here.azimuth + turn,
            self.params.dump_radius,
            max(here.height, self._survey.dump_clearance_height(observation, self._dump_azimuth)),
            self._kinematics.level_attitude,
        )
        return self._timed_waypoints(
            here, [_interpolate(here, over, part) for part in (0.25, 0.5, 0.75, 1.0)]
        )

    def _dump_waypoints(self, observation: Observation, here: BucketPose) -> list[Waypoint]:
        """Open the bucket over the dump."""
        turn = math.remainder(self._dump_azimuth - here.azimuth, 2 * math.pi)
        open_ = here._replace(
            azimuth=here.azimuth + turn,
            attitude=self._kinematics.level_attitude - self.params.dump_opening_angle,
        )
        return self._timed_waypoints(here, [open_])

    def _transfer_poses(
        self, observation: Observation, here: BucketPose, to: BucketPose
    ) -> list[BucketPose]:
        """Way points that keep the bucket clear of the ground on the way around."""
        turn = math.remainder(to.azimuth - here.azimuth, 2 * math.pi)
        height = self._survey.swing_clearance_height(observation, here.azimuth, to.azimuth)
        attitude = (
            self._kinematics.level_attitude
            if observation.fill > self.params.empty_threshold
            else to.attitude
        )
        up = here._replace(height=max(here.height, height))
        there = BucketPose(here.azimuth + turn, to.radius, max(to.height, height), attitude)
        return [up, _interpolate(up, there, 0.5), there] if abs(turn) > 0.1 else [up]

    def _timed_waypoints(self, start: BucketPose, places: list[BucketPose]) -> list[Waypoint]:
        """Give each way point the time that its slowest part needs."""
        speeds = np.array(
            [
                self.params.swing_speed,
                self.params.lip_travel_speed,
                self.params.lip_travel_speed,
                self.params.curl_speed,
            ]
        )
        targets = []
        for place in places:
            way = np.abs(np.subtract(place, start))
            way[0] = abs(math.remainder(place.azimuth - start.azimuth, 2 * math.pi))
            targets.append(Waypoint(place, float((way / speeds).max()) + 0.02))
            start = place
        return targets


def _interpolate(a: BucketPose, b: BucketPose, part: float) -> BucketPose:
    return BucketPose(*(x + part * (y - x) for x, y in zip(a, b, strict=True)))
