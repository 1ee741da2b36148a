"""WaypointPlanner: waypoints of the bucket for each phase of a dig cycle."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from dig_operator.bucket_kinematics import BucketKinematics, BucketPose
from dig_operator.dig_plan import DigPlan, plan_dig
from dig_operator.dump_target import DumpPoint, DumpTarget
from dig_operator.observation import Observation
from dig_operator.params import BehaviourParams
from dig_operator.swing_follower import SwingFollower
from dig_operator.terrain_survey import TerrainSurvey
from dig_operator.waypoint_follower import Waypoint, WaypointFollower
from machine_sim.machine.spec import MachineSpec

__all__ = ["Motion", "WaypointPlanner"]

Array = NDArray[np.float64]

_MAX_ATTITUDE_GRADIENT = 1.5
"""Maximum change of attitude along the path of the lip in the soil [rad/m]."""

_MAX_ATTITUDE_SPEED = 0.4
"""Maximum angular speed of the bucket in the soil [rad/s]."""

_ENTRY_HEIGHT = 0.05
"""Height of the lip above its entry into the soil from which on it moves slowly [m]."""

_ENTRY_DURATION = 0.3
"""Duration of the motion to the first waypoint in the soil [s]."""

_MIN_SWING_ANGLE = 0.25
"""Swing angle above which the reach is a swing [rad], and not a motion of the arm."""

_MAX_DUMP_LAG = 0.3
"""Error of the opening bucket at which its set point stops [rad]; its path does not matter."""

_EXTRA_DURATION = 0.02
"""Time added to the motion to each waypoint [s]."""

_FRACTIONS = (0.25, 0.5, 0.75, 1.0)
"""Fractions of a combined motion at which its waypoints lie."""


class Motion(Protocol):
    """A motion of the bucket."""

    @property
    def done(self) -> bool:
        """Whether it has reached its end."""

    def advance(self, observation: Observation, kinematics: BucketKinematics, dt: float) -> Array:
        """Return the joint velocities to command for the next `dt` [s], [rad/s], shape (4,)."""


class WaypointPlanner:
    """Plans the waypoints of each phase from the observed terrain.

    `reach`, `dig`, `curl`, `lift`, `swing`, `dump` and `stow` have one signature, so that
    `DigCycle` can call them by phase: the observation, and the pose of the bucket at the start of
    the phase. Those that only follow the plan or turn the bucket do not use the observation.

    Attributes:
        params: behaviour of the operator.
        dig_azimuth: middle of the sector to dig in [rad], map frame.
        dump_target: where to dump.
        kinematics: kinematics of the bucket.
        plan: plan of the present pass.
        plan_fraction: volume of the plan, as a fraction of what a pass should sweep by
            `target_fill` of the behaviour, or of the adapted volume where that is less.
    """

    def __init__(
        self,
        machine: MachineSpec,
        params: BehaviourParams,
        *,
        dig_azimuth: float,
        dump_target: DumpTarget,
    ) -> None:
        """
        Args:
            machine: the excavator.
            params: behaviour of the operator.
            dig_azimuth: middle of the sector to dig in [rad], map frame.
            dump_target: where to dump.
        """
        self.kinematics = BucketKinematics(machine)
        self.plan, self.plan_fraction = DigPlan.without_waypoints(), 0.0
        self.params = params
        self._survey = TerrainSurvey(self.kinematics, params, machine.bucket)
        self._capacity = machine.bucket.heaped_capacity
        self.dig_azimuth, self.dump_target = dig_azimuth, dump_target
        self._dump_point: DumpPoint | None = None  # of the present swing
        self._pass_azimuth = dig_azimuth
        self._attitudes: Array = np.zeros(0)  # of the bucket at each waypoint of the plan [rad]
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
        volume = self._capacity * target_fill
        self.plan = plan_dig(radius, surface, reach, volume)
        # Undug ground may have less than an adapted volume: then it is not dug out.
        self.plan_fraction = self.plan.volume / min(
            volume, self._capacity * self.params.target_fill
        )
        self._attitudes = self._plan_attitudes()

    def reach(self, observation: Observation, pose: BucketPose) -> Motion:
        """Move the bucket over the ground and other machines to above the entry of the plan."""
        above = self._lip_pose(0, self.params.clearance)
        if abs(math.remainder(above.azimuth - pose.azimuth, 2 * math.pi)) > _MIN_SWING_ANGLE:
            return self._swing_motion(observation, pose, above)
        depth = self._depth_below_pin(observation)
        heights = self._survey.swing_clearance_heights(
            observation, pose.azimuth, above.azimuth, depth
        )
        lifted = pose._replace(height=max(pose.height, float(heights.max())))
        return self._timed_motion(pose, [lifted, above])

    def stow(self, observation: Observation, pose: BucketPose) -> Motion:
        """Move the bucket ahead of the machine, above the ground that a retreat leads it over."""
        heights = self._survey.swing_clearance_heights(
            observation, self.dig_azimuth, self.dig_azimuth, self.kinematics.tip_length
        )
        near = self._survey.ground_height_near(observation, self.dig_azimuth)
        clear = near + self.kinematics.tip_length + self.params.clearance
        radius = 0.5 * (self.params.min_radius + self.params.max_radius)
        stowed = BucketPose(
            self.dig_azimuth,
            radius,
            max(float(heights.max()), clear),
            self.kinematics.level_attitude,
        )
        return self._swing_motion(observation, pose, stowed)

    def dig(self, observation: Observation, pose: BucketPose) -> Motion:
        """Lower the lip to the ground, and drag it along the plan."""
        plan, attitudes = self.plan, self._attitudes
        poses = [self._lip_pose(k) for k in range(plan.radius.size)]
        lip_times = np.hypot(np.diff(plan.radius), np.diff(plan.height)) / self.params.dig_speed
        turn_times = np.abs(np.diff(attitudes)) / _MAX_ATTITUDE_SPEED
        durations = [_ENTRY_DURATION, *np.maximum(lip_times, turn_times)]
        descent = self._timed_waypoints(pose, [self._lip_pose(0, _ENTRY_HEIGHT)])
        drag = (Waypoint(p, float(t)) for p, t in zip(poses, durations, strict=True))
        return WaypointFollower(pose, [*descent, *drag])

    def curl(self, observation: Observation, pose: BucketPose) -> Motion:
        """Turn the opening up while the lip comes out of the soil."""
        poses = [
            pose._replace(
                height=pose.height + fraction * self.params.curl_lift,
                attitude=pose.attitude
                + fraction * (self.kinematics.level_attitude - pose.attitude),
            )
            for fraction in _FRACTIONS
        ]
        return self._timed_motion(pose, poses)

    def lift(self, observation: Observation, pose: BucketPose) -> Motion:
        """Lift the level bucket straight up until it is clear of the ground beside it."""
        heights = self._survey.swing_clearance_heights(
            observation, pose.azimuth, pose.azimuth, self.kinematics.depth_below_pin
        )
        lifted = pose._replace(
            height=max(float(heights[0]), pose.height), attitude=self.kinematics.level_attitude
        )
        return self._timed_motion(pose, [lifted])

    def swing(self, observation: Observation, pose: BucketPose) -> Motion:
        """Swing the level bucket to the dump, and up to where it can open."""
        azimuth, radius = self._dump_point = self.dump_target.aim(observation)
        height = self._survey.dump_clearance_height(observation, azimuth, radius)
        above_dump = BucketPose(
            azimuth, radius, max(pose.height, height), self.kinematics.level_attitude
        )
        return self._swing_motion(observation, pose, above_dump)

    def dump(self, observation: Observation, pose: BucketPose) -> Motion:
        """Open the bucket above the dump."""
        assert self._dump_point is not None, "a dump follows a swing"
        angle = math.remainder(self._dump_point.azimuth - pose.azimuth, 2 * math.pi)
        opened = pose._replace(
            azimuth=pose.azimuth + angle,
            attitude=self.kinematics.level_attitude - self.params.dump_opening_angle,
        )
        waypoints = self._timed_waypoints(pose, [opened])
        return WaypointFollower(pose, waypoints, max_joint_lag=_MAX_DUMP_LAG)

    def _lip_pose(self, k: int, height: float = 0.0) -> BucketPose:
        """Return the pose with the lip a height [m] above waypoint `k` of the plan."""
        return self.kinematics.pose_with_lip_at(
            self._pass_azimuth,
            float(self.plan.radius[k]),
            float(self.plan.height[k]) + height,
            float(self._attitudes[k]),
        )

    def _plan_attitudes(self) -> Array:
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

    def _swing_motion(
        self, observation: Observation, start: BucketPose, target: BucketPose
    ) -> SwingFollower:
        """Return a swing during which the bucket is lifted and lowered.

        The bucket moves straight toward the target, and higher over ground and machines: as early
        as the swing needs to lift it there. It stays level until it is empty.
        """
        angle = math.remainder(target.azimuth - start.azimuth, 2 * math.pi)
        clear = self._survey.swing_clearance_heights(
            observation, start.azimuth, target.azimuth, self._depth_below_pin(observation)
        )
        step = abs(angle) / (clear.size - 1)
        max_rise = self.params.lip_travel_speed * step / self.params.swing_speed
        index = np.arange(clear.size)
        clear = (clear - max_rise * np.abs(index[:, None] - index)).max(axis=1)
        end = target._replace(azimuth=start.azimuth + angle)
        if self._is_loaded(observation):
            end = end._replace(attitude=self.kinematics.level_attitude)
        poses = []
        for k, height in enumerate(clear.tolist()):
            pose = _interpolate(start, end, k / (clear.size - 1))
            poses.append(pose._replace(height=max(pose.height, height)))
        poses[-1] = poses[-1]._replace(height=end.height)
        return SwingFollower(
            poses,
            swing_speed=self.params.swing_speed,
            max_joint_accelerations=self.params.max_joint_accelerations,
        )

    def _is_loaded(self, observation: Observation) -> bool:
        return observation.fill > self.params.empty_threshold

    def _depth_below_pin(self, observation: Observation) -> float:
        """Return the height of the pin above the lowest point of the bucket [m].

        An empty bucket may have any attitude.
        """
        is_loaded = self._is_loaded(observation)
        return self.kinematics.depth_below_pin if is_loaded else self.kinematics.tip_length

    def _timed_motion(self, start: BucketPose, poses: list[BucketPose]) -> WaypointFollower:
        """Return a motion along poses within the speed of every coordinate."""
        waypoints = self._timed_waypoints(start, poses)
        return WaypointFollower(start, waypoints)

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
