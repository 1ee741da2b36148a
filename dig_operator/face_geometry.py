"""FaceGeometry: rows of a face, and the boom angles that bring the cutting head to them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from dig_operator.face_params import FaceCuttingParams
from machine_sim.machine.errors import MachineError
from machine_sim.machine.spec import MachineSpec
from machine_sim.machine.tools.drum import DrumShape

__all__ = ["ROAD_HEADER_JOINTS", "FaceGeometry"]

ROAD_HEADER_JOINTS = ("turn", "lift", "head")
"""Joints of a road header: boom about z, boom about y, rotation of the cutting head."""


_NUM_POINTS_BEFORE_HEAD = 5
"""Number of points at which the ground before the head is observed."""


class FaceGeometry:
    """Boom angles of a road header for the rows of a face.

    Attributes:
        max_turn_angle: turn angle at the left edge of the face [rad]; its negative at the right.
        row_heights: heights of the head's axis above the floor, from the lowest row up [m].
    """

    def __init__(self, machine: MachineSpec, params: FaceCuttingParams) -> None:
        """
        Args:
            machine: the road header.
            params: the face.

        Raises:
            MachineError: the machine has other joints or no drum, or the face is out of reach.
        """
        if machine.joint_names != ROAD_HEADER_JOINTS:
            raise MachineError(
                f"a {machine.name} has joints {', '.join(machine.joint_names)}; give a machine with"
                f" {', '.join(ROAD_HEADER_JOINTS)}"
            )
        drum = next(
            (t.shape for t in machine.tools.values() if isinstance(t.shape, DrumShape)), None
        )
        if drum is None:
            raise MachineError(f"a {machine.name} has no drum; add one to its tools")
        turn, lift, head = machine.joints.values()
        _validate_params(params, drum, head.max_velocity)
        self._turn_limits, self._lift_limits = turn, lift
        self._drum, self._turn_x, self._lift_x = drum, turn.origin[0], lift.origin[0]
        self._pivot_height = turn.origin[2] + lift.origin[2]
        self._boom_length = head.origin[0]
        self._slew_radius = lift.origin[0] + self._boom_length
        self.max_turn_angle = self._turn_angle(0.5 * (params.width - drum.width))
        self.row_heights = _row_heights(params, drum)
        for height in self.row_heights:
            self.lift_angle(height)

    def lift_angle(self, height: float) -> float:
        """Return the lift angle [rad] that puts the head's axis at a height above the floor [m].

        Raises:
            MachineError: the boom does not reach that height.
        """
        sine = (self._pivot_height - height) / self._boom_length
        limits = self._lift_limits
        if not -1.0 <= sine <= 1.0 or not limits.lower <= math.asin(sine) <= limits.upper:
            raise MachineError(
                f"the boom cannot put its head {height:.2f} m high; give a face of another height"
            )
        return math.asin(sine)

    @property
    def drum(self) -> DrumShape:
        """Shape of the cutting head."""
        return self._drum

    def points_before_head(self, turn: float, lift: float, distance: float) -> NDArray[np.float64]:
        """Return points along the width of the head, before it [m], base frame, shape (n, 2).

        Args:
            turn, lift: angles of the boom [rad].
            distance: distance of the points from the tips of the picks [m].
        """
        reach = self._lift_x + self._boom_length * math.cos(lift) + self._drum.radius + distance
        along = np.array([math.cos(turn), math.sin(turn)])
        across = np.array([-along[1], along[0]])
        half = 0.5 * self._drum.width
        offsets = np.linspace(-half, half, _NUM_POINTS_BEFORE_HEAD)[:, None]
        points: NDArray[np.float64] = reach * along + offsets * across + [self._turn_x, 0.0]
        return points

    def clip_turn_angle(self, angle: float) -> float:
        """Return the attainable turn angle that is nearest to an angle [rad]."""
        return min(max(angle, self._turn_limits.lower), self._turn_limits.upper)

    def _turn_angle(self, offset: float) -> float:
        """Return the turn angle [rad] that puts the head `offset` [m] to the left."""
        if not 0.0 <= offset < self._slew_radius:
            raise MachineError(
                f"a face {2.0 * offset:.2f} m wider than the head is beyond the boom; give a"
                " narrower face"
            )
        angle = math.asin(offset / self._slew_radius)
        max_angle = min(self._turn_limits.upper, -self._turn_limits.lower)
        if angle > max_angle:
            raise MachineError(
                f"the boom would have to turn {angle:.2f} rad to either side, its limit is"
                f" {max_angle:.2f} rad; give a narrower face"
            )
        return angle


def _validate_params(params: FaceCuttingParams, drum: DrumShape, max_head_speed: float) -> None:
    if params.head_angular_velocity > max_head_speed:
        raise MachineError(
            f"head_angular_velocity is {params.head_angular_velocity} rad/s; give at most"
            f" {max_head_speed} rad/s, the limit of the head"
        )
    if params.width < drum.width or params.height < 2.0 * drum.radius:
        raise MachineError(
            f"a face {params.width} m wide and {params.height} m high is smaller than the head;"
            f" give a width of at least {drum.width} m and a height of at least"
            f" {2.0 * drum.radius} m"
        )


def _row_heights(params: FaceCuttingParams, drum: DrumShape) -> list[float]:
    """Return the heights of the head's axis in each row, from the floor up [m]."""
    low, high = drum.radius, params.height - drum.radius
    spacing = (2.0 - params.overlap) * drum.radius
    num_rows = max(math.ceil((high - low) / spacing), 0) + 1
    return [float(height) for height in np.linspace(low, max(high, low), num_rows)]
