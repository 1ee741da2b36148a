"""Where an excavator dumps: at a fixed place on the ground, or into the bed of another machine."""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from dig_operator.bed import EMPTY_FILL, bed_joint, bed_of, has_bed
from dig_operator.bucket_kinematics import BucketKinematics
from dig_operator.observation import Observation
from dig_operator.observed_machine import ObservedMachine
from machine_sim.machine.tools.bed import BedShape

__all__ = ["BedTarget", "DumpPoint", "DumpTarget", "HeapTarget"]

_BED_OFFSETS = (0.0, 0.15, -0.1)
"""Points of a bed that are filled in turn, as fractions of its length from the middle forward."""

_MAX_REST_SPEED = 0.03
"""Speed below which a machine counts as standing [m/s]."""

_DRIVING_SPEED = 0.2
"""Speed above which a machine drives; soil that falls into its bed shakes it [m/s]."""

_MAX_LOWERED_ANGLE = 0.06
"""Angle from its rest position below which a bed counts as lowered [rad]."""

_MAX_AGE = 0.5
"""Age of the last state of a machine from which on it is not known where it is [s]."""

_EMPTIED_FRACTION = 0.5
"""Fraction of the maximum fill below which a bed has been emptied, and a new load begins; some soil
may stick to it."""


class DumpPoint(NamedTuple):
    """Where to open the bucket.

    Attributes:
        azimuth: direction from the swing axis [rad], map frame.
        radius: distance of the bucket's pin from there [m].
    """

    azimuth: float
    radius: float


class DumpTarget(Protocol):
    """A place to dump at."""

    def watch(self, observation: Observation) -> None:
        """Take note of the present state; call it at every observation."""

    def find_obstacle(self, observation: Observation, *, is_swinging: bool) -> str:
        """Return why the bucket cannot be dumped now, for the user; empty if it can.

        Args:
            observation: present state.
            is_swinging: whether the bucket is being swung there: that a target has become full
                is no reason to stop then.
        """

    def aim(self, observation: Observation) -> DumpPoint:
        """Return where to open the bucket; only while there is no obstacle."""

    def count_dump(self, observation: Observation) -> None:
        """Note that a bucket has been dumped."""


class HeapTarget:
    """A fixed direction and radius."""

    def __init__(self, azimuth: float, radius: float) -> None:
        """
        Args:
            azimuth: direction from the swing axis [rad], map frame.
            radius: radius of the bucket's pin over the dump [m].
        """
        self._point = DumpPoint(azimuth, radius)

    def watch(self, observation: Observation) -> None:
        """Do nothing."""

    def find_obstacle(self, observation: Observation, *, is_swinging: bool) -> str:
        """Return an empty string: a place on the ground is always ready."""
        return ""

    def aim(self, observation: Observation) -> DumpPoint:
        """Return the fixed point."""
        return self._point

    def count_dump(self, observation: Observation) -> None:
        """Do nothing."""


class BedTarget:
    """The bed of another machine, wherever that stands.

    The bucket is dumped only while the machine stands, its bed is lowered and its middle is in
    reach. Successive buckets are dumped at different points along the bed.

    Attributes:
        num_loads: number of loads: a bed that is full, or is driven out of reach after a dump.
        is_loading: whether a load has begun and is not counted yet.
    """

    def __init__(
        self,
        name: str,
        kinematics: BucketKinematics,
        *,
        min_radius: float,
        max_radius: float,
        full_fill: float,
    ) -> None:
        """
        Args:
            name: namespace of the machine.
            kinematics: kinematics of the bucket, from the swing axis.
            min_radius, max_radius: radii at which the bucket can be dumped [m].
            full_fill: fill of the bed from which on it counts as full.
        """
        self._name, self._full_fill = name, full_fill
        self._swing_axis = kinematics.swing_axis
        self._min_radius, self._max_radius = min_radius, max_radius
        self._num_dumps = 0  # into the present load
        self._is_counted = False  # the present load
        self._max_fill = 0.0  # of the present load
        self._initial_fill = math.inf  # of the present load: what sticks to the bed
        self._dump_position: NDArray[np.float64] | None = None  # of the machine at the last dump
        self.num_loads, self.is_loading = 0, False

    def watch(self, observation: Observation) -> None:
        """Count a load that is driven away."""
        truck = self._find(observation)
        if truck is None or not has_bed(truck.spec):
            return
        self._max_fill = max(self._max_fill, truck.fill)
        if truck.fill < _EMPTIED_FRACTION * self._max_fill:
            self._num_dumps, self._is_counted, self._max_fill = 0, False, 0.0
            self._initial_fill = truck.fill
        self._initial_fill = min(self._initial_fill, truck.fill)
        if self._has_left(observation, truck):
            self._count_load()
        self.is_loading = not self._is_counted and truck.fill > self._initial_fill + EMPTY_FILL

    def find_obstacle(self, observation: Observation, *, is_swinging: bool) -> str:
        """Return why the bucket cannot be dumped into the bed now; empty if it can."""
        truck = self._find(observation)
        if truck is None:
            return f"{self._name}, whose state is not known"
        if not has_bed(truck.spec):
            return f"{self._name}, which has no bed; set task.truck to another machine"
        if truck.age > _MAX_AGE:
            return f"{self._name}, which sends no messages"
        max_speed = _DRIVING_SPEED if is_swinging else _MAX_REST_SPEED
        if truck.speed > max_speed:
            return f"{self._name}, which is driving"
        joint = bed_joint(truck.spec)
        bed_angle = abs(float(truck.joints[joint] - truck.spec.home[joint]))
        if bed_angle > _MAX_LOWERED_ANGLE:
            return f"{self._name}, whose bed is raised"
        if not self._is_in_reach(observation, truck):
            radius = self._bed_point(observation, truck, 0.0).radius
            return (
                f"{self._name}, whose bed is {radius:.1f} m away; it must be"
                f" {self._min_radius:g} to {self._max_radius:g} m from the excavator's swing axis"
            )
        if not is_swinging and truck.fill >= self._full_fill:
            return f"{self._name}, which is full"
        return ""

    def aim(self, observation: Observation) -> DumpPoint:
        """Return the point for the next bucket.

        Raises:
            LookupError: the state of the machine is not known; see `find_obstacle`.
        """
        truck = self._find(observation)
        if truck is None:
            raise LookupError(f"the state of {self._name} is not known")
        offset = _BED_OFFSETS[self._num_dumps % len(_BED_OFFSETS)]
        point = self._bed_point(observation, truck, offset)
        radius = min(max(point.radius, self._min_radius), self._max_radius)
        return point._replace(radius=radius)

    def count_dump(self, observation: Observation) -> None:
        """Note that a bucket has been dumped; a bed that is full now is a load."""
        self._num_dumps += 1
        truck = self._find(observation)
        self._dump_position = None if truck is None else truck.base_position
        if truck is not None and truck.fill >= self._full_fill:
            self._count_load()

    def _count_load(self) -> None:
        """Count the present load, once."""
        if self._num_dumps > 0 and not self._is_counted:
            self.num_loads += 1
            self._is_counted = True

    def _has_left(self, observation: Observation, truck: ObservedMachine) -> bool:
        """Return whether the machine has been driven away since the last dump.

        False if only the excavator moved, or both moved along the dig.
        """
        if self._num_dumps == 0 or self._dump_position is None:
            return False
        distance = float(np.linalg.norm(truck.base_position - self._dump_position))
        return distance > self._max_radius and not self._is_in_reach(observation, truck)

    def _is_in_reach(self, observation: Observation, truck: ObservedMachine) -> bool:
        radius = self._bed_point(observation, truck, 0.0).radius
        return self._min_radius <= radius <= self._max_radius

    def _find(self, observation: Observation) -> ObservedMachine | None:
        return next((each for each in observation.others if each.name == self._name), None)

    def _bed_point(
        self, observation: Observation, truck: ObservedMachine, offset: float
    ) -> DumpPoint:
        """Return the point over the bed, a fraction of its length forward of its middle."""
        link, shape = bed_of(truck.spec)
        rotation, origin = truck.link_frames[link]
        x, z = _bed_middle(shape)
        length = float(np.ptp(shape.profile[:, 0]))
        middle = origin + rotation @ np.array([x + offset * length, 0.0, z])
        dx, dy = (middle - self._swing_axis(observation))[:2].tolist()
        return DumpPoint(math.atan2(dy, dx), math.hypot(dx, dy))


def _bed_middle(shape: BedShape) -> NDArray[np.float64]:
    """Return the centroid of the struck volume in the side view (x, z) [m], link frame, (2,)."""
    points = shape.profile
    following = np.roll(points, -1, axis=0)
    cross = points[:, 0] * following[:, 1] - following[:, 0] * points[:, 1]
    return np.asarray(((points + following) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum()))
