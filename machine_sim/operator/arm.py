"""The arm as an operator thinks of it: put the bucket there, at that slant.

Places are given over the map: direction (azimuth) and radius from the swing axis, height above the
map's zero. Slants are attitudes: the angle of the line from pin to lip below the horizontal.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.description import MachineDescription
from machine_sim.machine.kinematics import pin_angles, rotation_about_z, to_arm_plane, tool_pose
from machine_sim.operator.view import View

__all__ = ["ArmPlane"]

Array = NDArray[np.float64]


class ArmPlane:
    """Where the bucket of one machine can be put.

    Attributes:
        level: attitude at which the bucket's mouth looks straight up [rad].
        depth_below_pin: how far the bucket reaches below its pin when level [m].
    """

    def __init__(self, machine: MachineDescription) -> None:
        self._machine = machine
        bucket = machine.bucket
        self._length = bucket.tip_length
        nx, _, nz = bucket.mouth_normal
        self.level = math.atan2(-nx, nz) % (2 * math.pi)
        x, z = bucket.profile.T
        self.depth_below_pin = float((x * math.sin(self.level) - z * math.cos(self.level)).max())
        (x0, z0), (x1, z1) = bucket.profile[:2]
        self._lip_angle = math.atan2(z0 - z1, x0 - x1)

    def attitude_of_attack(self, angle: float) -> float:
        """Attitude at which the floor behind the lip slants `angle` [rad] below level.

        The lip points toward the machine; with a positive angle it goes down into the soil.
        """
        return (self._lip_angle - math.pi - angle) % (2 * math.pi)

    def pin(self, radius: float, height: float, attitude: float) -> tuple[float, float]:
        """Radius and height of the pin [m] for the lip's."""
        return (
            radius - self._length * math.cos(attitude),
            height + self._length * math.sin(attitude),
        )

    def pin_of(self, view: View) -> tuple[float, float]:
        """Radius and height of the pin [m] as seen."""
        _, pin = tool_pose(self._machine, view.base_position, view.base_rotation, view.joints)
        axis = self._axis(view)
        return math.hypot(pin[0] - axis[0], pin[1] - axis[1]), float(pin[2])

    def azimuth(self, view: View) -> float:
        """Direction of the arm [rad], map frame."""
        forward = (view.base_rotation @ rotation_about_z(view.joints[0]))[:, 0]
        return math.atan2(forward[1], forward[0])

    def joints(
        self, view: View, azimuth: float, radius: float, height: float, attitude: float
    ) -> Array:
        """Joint angles [rad], shape (4,), that put the pin there with the bucket at that slant.

        A bucket joint at its limit leaves the bucket at the nearest slant it can have.

        Raises:
            ReachError: the pin cannot be there.
        """
        axis = self._axis(view)
        target = np.array(
            [
                axis[0] + radius * math.cos(azimuth),
                axis[1] + radius * math.sin(azimuth),
                height,
            ]
        )
        base = (self._machine, view.base_position, view.base_rotation)
        across = to_arm_plane(*base, 0.0, target)
        swing = math.atan2(across[1], across[0])
        # The same direction again, whole turns away, as near as can be to where it is.
        swing = view.joints[0] + math.remainder(swing - view.joints[0], 2 * math.pi)
        reach, _, above = to_arm_plane(*base, swing, target)
        boom, arm = pin_angles(self._machine, float(reach), float(above))
        forward = (view.base_rotation @ rotation_about_z(swing))[:, 0]
        tilt = math.asin(max(-1.0, min(1.0, float(forward[2]))))
        limits = self._machine.joints["bucket"]
        bucket = min(max(attitude + tilt - boom - arm, limits.lower), limits.upper)
        return np.array([swing, boom, arm, bucket])

    def opened(self, view: View) -> Array:
        """Joints as they are, but the bucket open to pour."""
        joints = view.joints.copy()
        joints[3] = self._machine.joints["bucket"].lower
        return joints

    def _axis(self, view: View) -> Array:
        origin = np.array(self._machine.swing_origin)
        return np.asarray(view.base_position + view.base_rotation @ origin, dtype=np.float64)
