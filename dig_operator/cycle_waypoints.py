"""WaypointPlanner: waypoints of the bucket for each phase of a dig cycle."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dig_operator.bucket_kinematics import BucketKinematics, BucketPose
from dig_operator.dig_plan import DigPlan, plan_dig
from dig_operator.observation import Observation
from dig_operator.params import BehaviourParams
from dig_operator.terrain_survey import TerrainSurvey
from dig_operator.waypoint_follower import Waypoint
from machine_sim.machine.spec import MachineSpec

__all__ = ["WaypointPlanner"]

Array = NDArray[np.float64]

_MAX_ATTITUDE_GRADIENT = 1.5
"""Maximum change of attitude along the path of the lip in the soil [rad/m]."""

_MAX_ATTITUDE_SPEED = 0.4
"""Maximum angular speed of the bucket in the soil [rad/s]."""

_ENTRY_HEIGHT = 0.05
"""Height of the lip above its entry into the soil at the end of the reach [m]."""

_ENTRY_DURATION = 0.3
"""Duration of the motion to the first waypoint in the soil [s]."""

_MIN_TRANSFER_ANGLE = 0.1
"""Swing angle from which on a transfer goes over the clearance height [rad]."""

_EXTRA_DURATION = 0.02
"""Time added to the motion to each waypoint [s]."""

_FRACTIONS = (0.25, 0.5, 0.75, 1.0)
"""Fractions of a combined motion at which its waypoints lie."""


class WaypointPlanner:
    """Plans the waypoints of each phase from the observed terrain.

    `reach`, `dig`, `curl`, `lift`, `swing` and `dump` have one signature, so that `DigCycle` can
    call them by phase: the observation, and the pose of the bucket at the start of the phase. Those
    that only follow the plan or turn the bucket do not use the observation.

    Attributes:
        params: behaviour of the operator.
        dig_azimuth: middle of the sector to dig in [rad], map frame.
        dump_azimuth: direction of the dump [rad], map frame.
        kinematics: kinematics of the bucket.
        plan: plan of the present pass.
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
            machine: the excavator.
            params: behaviour of the operator.
            dig_azimuth: middle of the sector to dig in [rad], map frame.
            dump_azimuth: direction of the dump [rad], map frame.
        """
        self.kinematics = BucketKinematics(machine)
        self.plan = DigPlan.without_waypoints()
        self.params = params
        self._survey = TerrainSurvey(self.kinematics, params, machine.bucket)
        self._capacity = machine.bucket.heaped_capacity
        self.dig_azimuth, self.dump_azimuth = dig_azimuth, dump_azimuth
        self._pass_azimuth = dig_azimuth
        self._entry_attitude = self.kinematics.attitude_for_attack_angle(params.entry_angle)
        self._exit_attitude = self.kinematics.attitude_for_attack_angle(params.exit_angle)

    def plan_pass(self, observation: Observation, target_fill: float, *, is_first: bool) -> None:
        """Plan a pass that sweeps a fraction of the bucket's heaped capacity.

        Soil already in the bucket is not subtracted: it falls out where the bucket enters.

        Args:
            observation: the terrain.
            target_fill: fraction of the heaped capacity to sweep.
            is_first: whether the cycle begins; its further passes keep the azimuth.

        Raises:
            ReachError: there is no ground in reach.
        """
        if is_first:
            self._pass_azimuth = self._survey.highest_ground_azimuth(observation, self.dig_azimuth)
        reach = self._survey.dig_reach(observation, self._pass_azimuth, self._entry_attitude)
        radius, surface = self._survey.surface_profile(observation, self._pass_azimuth)
        self.plan = plan_dig(radius, surface, reach, self._capacity * target_fill)

    def reach(self, observation: Observation, pose: BucketPose) -> list[Waypoint]:
        """Move the bucket over the ground to above the entry of the plan, and down to it."""
        entry_radius, entry_height = float(self.plan.radius[0]), float(self.plan.height[0])
        attitude = float(self._attitudes()[0])

        def lip_pose(height: float) -> BucketPose:
            return self.kinematics.pose_with_lip_at(
                self._pass_azimuth, entry_radius, height, attitude
            )

        above = lip_pose(entry_height + self.params.clearance)
        entry = lip_pose(entry_height + _ENTRY_HEIGHT)
        transfer = self._transfer_poses(observation, pose, above)
        return self._timed_waypoints(pose, [*transfer, above, entry])

    def dig(self, observation: Observation, pose: BucketPose) -> list[Waypoint]:
        """Drag the lip along the plan."""
        plan, attitudes = self.plan, self._attitudes()
        poses = [
            self.kinematics.pose_with_lip_at(self._pass_azimuth, radius, height, attitude)
            for radius, height, attitude in zip(plan.radius, plan.height, attitudes, strict=True)
        ]
        lip_times = np.hypot(np.diff(plan.radius), np.diff(plan.height)) / self.params.dig_speed
        turn_times = np.abs(np.diff(attitudes)) / _MAX_ATTITUDE_SPEED
        durations = [_ENTRY_DURATION, *np.maximum(lip_times, turn_times)]
        return [Waypoint(p, float(t)) for p, t in zip(poses, durations, strict=True)]

    def curl(self, observation: Observation, pose: BucketPose) -> list[Waypoint]:
        """Turn the opening up while the lip comes out of the soil."""
        poses = [
            pose._replace(
                height=pose.height + fraction * self.params.curl_lift,
                attitude=pose.attitude
                + fraction * (self.kinematics.level_attitude - pose.attitude),
            )
            for fraction in _FRACTIONS
        ]
        return self._timed_waypoints(pose, poses)

    def lift(self, observation: Observation, pose: BucketPose) -> list[Waypoint]:
        """Lift the level bucket straight up to the clearance height of the swing."""
        height = self._survey.swing_clearance_height(observation, pose.azimuth, self.dump_azimuth)
        lifted = pose._replace(
            height=max(height, pose.height), attitude=self.kinematics.level_attitude
        )
        return self._timed_waypoints(pose, [lifted])

    def swing(self, observation: Observation, pose: BucketPose) -> list[Waypoint]:
        """Swing the level bucket to the dump, and up to where it can open above the heap."""
        angle = math.remainder(self.dump_azimuth - pose.azimuth, 2 * math.pi)
        above_dump = BucketPose(
            pose.azimuth + angle,
            self.params.dump_radius,
            max(pose.height, self._survey.dump_clearance_height(observation, self.dump_azimuth)),
            self.kinematics.level_attitude,
        )
        return self._timed_waypoints(
            pose, [_interpolate(pose, above_dump, fraction) for fraction in _FRACTIONS]
        )

    def dump(self, observation: Observation, pose: BucketPose) -> list[Waypoint]:
        """Open the bucket above the dump."""
        angle = math.remainder(self.dump_azimuth - pose.azimuth, 2 * math.pi)
        opened = pose._replace(
            azimuth=pose.azimuth + angle,
            attitude=self.kinematics.level_attitude - self.params.dump_opening_angle,
        )
        return self._timed_waypoints(pose, [opened])

    def _attitudes(self) -> Array:
        """Return the attitude of the bucket at each waypoint of the plan [rad], shape (n,).

        It changes from the entry to the exit attitude, limited so that the bucket's floor does not
        drag over the ground behind the lip, and so that it changes slowly along the path.
        """
        plan = self.plan
        attitudes = np.linspace(self._entry_attitude, self._exit_attitude, plan.radius.size)
        slopes = np.arctan(np.gradient(plan.height, plan.radius))  # downward motion is positive
        max_attitudes = [
            self.kinematics.attitude_for_attack_angle(slope + self.params.relief_angle)
            for slope in slopes
        ]
        attitudes = np.minimum(attitudes, max_attitudes)
        distances = np.abs(plan.radius[:, None] - plan.radius)
        return np.asarray((attitudes + _MAX_ATTITUDE_GRADIENT * distances).min(axis=1))

    def _transfer_poses(
        self, observation: Observation, pose: BucketPose, target: BucketPose
    ) -> list[BucketPose]:
        """Return poses that keep the bucket clear of the ground on the way to a target."""
        angle = math.remainder(target.azimuth - pose.azimuth, 2 * math.pi)
        height = self._survey.swing_clearance_height(observation, pose.azimuth, target.azimuth)
        is_loaded = observation.fill > self.params.empty_threshold
        attitude = self.kinematics.level_attitude if is_loaded else target.attitude
        lifted = pose._replace(height=max(pose.height, height))
        if abs(angle) <= _MIN_TRANSFER_ANGLE:
            return [lifted]
        above_target = BucketPose(
            pose.azimuth + angle, target.radius, max(target.height, height), attitude
        )
        return [lifted, _interpolate(lifted, above_target, 0.5), above_target]

    def _timed_waypoints(self, start: BucketPose, poses: list[BucketPose]) -> list[Waypoint]:
        """Return waypoints whose durations keep every coordinate within its speed."""
        params = self.params
        speeds = np.array(
            [
                params.swing_speed,
                params.lip_travel_speed,
                params.lip_travel_speed,
                params.curl_speed,
            ]
        )
        waypoints = []
        for pose in poses:
            distances = np.abs(np.subtract(pose, start))
            distances[0] = abs(math.remainder(pose.azimuth - start.azimuth, 2 * math.pi))
            waypoints.append(Waypoint(pose, float((distances / speeds).max()) + _EXTRA_DURATION))
            start = pose
        return waypoints


def _interpolate(a: BucketPose, b: BucketPose, fraction: float) -> BucketPose:
    """Return the pose at a fraction of the way from `a` to `b`, linear in each coordinate."""
    return BucketPose(*(x + fraction * (y - x) for x, y in zip(a, b, strict=True)))
