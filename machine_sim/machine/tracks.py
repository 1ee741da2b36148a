"""Fast tracks: one degree of freedom per belt, its shoes placed on the path and felt by the ground.

The shoes are no rigid bodies. They move on the stadium round sprocket and idler, touch the
machine's own copy of the terrain, and what they feel comes back as one wrench on the base.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.ground import Ground
from machine_sim.machine.description import MachineDescription, TrackShape
from machine_sim.machine.errors import MachineError
from machine_sim.machine.track_contact import track_step

__all__ = ["FastTracks", "standing_pose"]

Array = NDArray[np.float64]

GRAVITY = 9.81
"""[m/s^2]"""


class FastTracks:
    """The two tracks of a machine on the ground.

    Attributes:
        command: wanted speeds left, right [m/s], shape (2,).
        travel: how far each belt has run, modulo its length [m], shape (2,).
        speed: belt speeds [m/s], shape (2,).
        shoe_poses: x, z [m] and pitch about +y [rad] of each shoe in the base frame, left track
            first, shape (2, shoe_count, 3); y is plus and minus half the gauge.
        shoe_loads: normal load on each shoe [N], shape (2, shoe_count).
        wrench: force [N] and torque about the base's centre of mass [N m] of the last step, map
            frame, shape (6,).
    """

    def __init__(self, description: MachineDescription, ground: Ground) -> None:
        """
        Args:
            description: the machine.
            ground: what the shoes touch; its contact surface is read at each step.
        """
        shape = description.tracks
        count = shape.shoe_count
        self.command: Array = np.zeros(2)
        self.travel: Array = np.zeros(2)
        self.speed: Array = np.zeros(2)
        self.shoe_poses: Array = np.zeros((2, count, 3))
        self.shoe_loads: Array = np.zeros((2, count))
        self.wrench: Array = np.zeros(6)
        self._ground = ground
        self._frame = ground.frame
        self._base_com = np.array(description.links["base"].center_of_mass)
        self._hull = _hull(description)
        self._anchors: Array = np.zeros((4 * count + len(self._hull), 3))
        self._active: NDArray[np.bool_] = np.zeros(len(self._anchors), dtype=np.bool_)
        self._shape = (
            0.5 * shape.axle_distance,
            shape.sprocket_radius,
            0.5 * shape.gauge,
            0.5 * shape.shoe_width,
            0.5 * shape.shoe_thickness,
            shape.axle_height,
        )
        self._laws = (  # two contact points share one shoe's
            0.5 * shape.normal_stiffness,
            0.5 * shape.normal_damping,
            0.5 * shape.tangential_stiffness,
            0.5 * shape.tangential_damping,
            shape.friction,
        )
        self._drive = (shape.belt_mass, shape.acceleration, shape.braking, shape.traction)

    @property
    def shoes_in_contact(self) -> int:
        """Number of shoes that carry load."""
        return int(np.count_nonzero(self.shoe_loads))

    def step(
        self,
        dt: float,
        com: Array,
        rotation: Array,
        velocity: Array,
        spin: Array,
        swing: float,
    ) -> Array:
        """Advance the belts and return the ground's wrench on the base, shape (6,).

        Args:
            dt: time step [s].
            com, rotation: base centre of mass [m] and base to map, shape (3, 3).
            velocity, spin: of the centre of mass [m/s] and angular [rad/s], map frame.
            swing: swing angle [rad]; the upper body's corners touch the ground too.
        """
        track_step(
            dt,
            com,
            rotation,
            velocity,
            spin,
            self._base_com,
            self._hull,
            math.cos(swing),
            math.sin(swing),
            self._shape,
            self._laws,
            self._drive,
            self._ground.surface,
            self._frame,
            self.command,
            self.travel,
            self.speed,
            self._anchors,
            self._active,
            self.shoe_poses,
            self.shoe_loads,
            self.wrench,
        )
        return self.wrench


def standing_pose(
    description: MachineDescription, ground: Ground, x: float, y: float, yaw: float
) -> tuple[Array, Array]:
    """Where the base frame rests on the ground under (x, y) [m], facing `yaw` [rad].

    The tracks stand on the plane that fits the ground under them best, pressed in by the weight.

    Returns:
        Position [m], shape (3,), and rotation base to map, shape (3, 3).

    Raises:
        MachineError: numbers that are not finite, or a place off the map.
    """
    if not all(map(math.isfinite, (x, y, yaw))):
        raise MachineError(f"position ({x}, {y}) and yaw {yaw} of a machine must be finite")
    if not ground.grid.contains(x, y):
        raise MachineError(
            f"({x}, {y}) m is off the map, which ends at {0.5 * ground.grid.size[0]:g},"
            f" {0.5 * ground.grid.size[1]:g} m: place the machine on it"
        )
    along, across = _footprint(description.tracks)
    c, s = math.cos(yaw), math.sin(yaw)
    heights = [
        ground.height(x + c * a - s * b, y + s * a + c * b)
        for a, b in zip(along, across, strict=True)
    ]
    fit = np.linalg.lstsq(
        np.column_stack([np.ones_like(along), along, across]), np.array(heights), rcond=None
    )[0]
    forward = np.array([c, s, fit[1]])
    leftward = np.array([-s, c, fit[2]])
    normal = np.cross(forward, leftward)
    normal /= np.linalg.norm(normal)
    forward /= np.linalg.norm(forward)
    rotation = np.column_stack([forward, np.cross(normal, forward), normal])
    shape = description.tracks
    carrying = 2.0 * shape.axle_distance / shape.pitch  # shoes
    sink = description.mass * GRAVITY * normal[2] / (carrying * shape.normal_stiffness)
    return np.array([x, y, fit[0]]) - sink * normal, rotation


def _footprint(shape: TrackShape) -> tuple[Array, Array]:
    """Points under both tracks [m], base frame: x and y, each shape (n,)."""
    half = 0.5 * shape.axle_distance
    sides = [
        0.5 * side * (shape.gauge + edge * shape.shoe_width) for side in (1, -1) for edge in (1, -1)
    ]
    along, across = np.meshgrid(np.linspace(-half, half, 9), sides)
    return along.ravel(), across.ravel()


def _hull(description: MachineDescription) -> Array:
    """Corners of the upper body's first box at swing 0 [m], base frame, shape (8, 3)."""
    boxes = description.links["upper"].boxes
    if not boxes:
        return np.zeros((0, 3))
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    corners = np.array(boxes[0].center) + 0.5 * signs * np.array(boxes[0].size)
    return np.asarray(corners + np.array(description.swing_origin), dtype=np.float64)
