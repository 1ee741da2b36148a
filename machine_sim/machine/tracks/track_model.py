"""Tracks of a machine: what the fast and the hinged ones have in common, and how they are set down.

- `fast`: belts of one degree of freedom each, shoes placed on the path (`KinematicTracks`)
- `physics`: rigid shoes hinged to one another, driven by the sprocket's friction (`DynamicTracks`)
"""

from __future__ import annotations

import math
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from machine_sim.ground.contact_surface import Ground, surface_at
from machine_sim.machine.errors import MachineError
from machine_sim.machine.spec import MachineSpec, TrackSpec
from machine_sim.machine.tracks.running_gear import with_dynamic_tracks
from machine_sim.machine.tracks.terramechanics import soil_coefficients
from msg_bridge.kernels import kernel

__all__ = [
    "TRACK_MODELS",
    "TrackModel",
    "Tracks",
    "hull_corners",
    "sole_heights",
    "standing_pose",
    "track_slip",
    "with_track_model",
]

Array = NDArray[np.float64]

TrackModel = Literal["kinematic", "dynamic"]

TRACK_MODELS: tuple[TrackModel, ...] = ("kinematic", "dynamic")
"""How tracks can be simulated."""

GRAVITY = 9.81
"""[m/s^2]"""

_STANDSTILL_SPEED = 0.01
"""What is slower than this neither drives nor slides [m/s]."""


def with_track_model(spec: MachineSpec, model: TrackModel) -> MachineSpec:
    """The machine as it is with tracks of that model: their count of shoes, and their radius."""
    return with_dynamic_tracks(spec) if model == "dynamic" else spec


class Tracks(Protocol):
    """The two tracks of a machine on the ground.

    Attributes:
        description: the machine as it is with them, `with_track_model`.
        command: wanted speeds left, right [m/s], shape (2,).
        travel: how far each belt has run, modulo its length [m], shape (2,).
        speed: belt speeds [m/s], shape (2,).
        shoe_poses: x, z [m] and pitch about +y [rad] of each shoe in the base frame, left track
            first, shape (2, shoe_count, 3); y is plus and minus half the gauge, or near it.
        shoe_loads: normal load on each shoe [N], shape (2, shoe_count).
        sinkage: how deep the soles of each side are below the ground as it was before tracks
            pressed it [m], the mean by load, shape (2,).
        wrench: force [N] and torque about the base's centre of mass [N m] of the ground on the
            whole machine in the last step, map frame, shape (6,).
    """

    spec: MachineSpec
    command: Array
    travel: Array
    speed: Array
    shoe_poses: Array
    shoe_loads: Array
    sinkage: Array
    wrench: Array

    @property
    def slip(self) -> Array:
        """Slip of each side over the last half second, shape (2,); see `track_slip`."""

    @property
    def shoes_in_contact(self) -> int:
        """Number of shoes that carry load."""

    def urdf(self) -> str:
        """URDF of the machine with what of the tracks is part of its multibody."""

    def attach(self, client: int, body: int, position: Array, rotation: Array) -> None:
        """Load what else there is of the tracks, and take hold of the multibody.

        Args:
            client: number of the physics client.
            body: number of the machine's multibody in it, in place.
            position, rotation: of the base frame, map frame [m], shapes (3,) and (3, 3).
        """

    def step(
        self,
        dt: float,
        com: Array,
        rotation: Array,
        velocity: Array,
        angular_velocity: Array,
        swing: float,
    ) -> Array:
        """Advance the belts and return the wrench to put on the base, shape (6,).

        Args:
            dt: time step [s].
            com, rotation: base centre of mass [m] and base to map, shape (3, 3).
            velocity, spin: of the centre of mass [m/s] and angular [rad/s], map frame.
            swing: swing angle [rad]; the upper body's corners touch the ground too.

        Raises:
            MachineError: a track has come off its path; the run cannot go on.
        """


def track_slip(mean_speeds: Array) -> Array:
    """How much faster belts run than their sides move over the ground, shape (2,).

    As a part of the faster of the two: 1 spins on the spot, -1 slides with the brake on. What is
    slower than 1 cm/s is 0.

    Args:
        paces: of belt and ground, left and right [m/s], shape (2, 2).
    """
    belt, ground = mean_speeds.T
    fastest = np.maximum(np.abs(belt), np.abs(ground))
    ahead = (belt - ground) * np.sign(np.where(np.abs(belt) < _STANDSTILL_SPEED, ground, belt))
    slip = np.where(
        fastest < _STANDSTILL_SPEED,
        0.0,
        np.clip(ahead / np.maximum(fastest, _STANDSTILL_SPEED), -1.0, 1.0),
    )
    return np.asarray(slip, dtype=np.float64)


def sole_heights(tracks: Tracks) -> Array:
    """Where the soles that carry are, left and right: z [m] in the base frame, shape (2,)."""
    shape = tracks.spec.tracks
    heights: Array = np.zeros(2)
    _mean_sole_heights(
        tracks.shoe_poses, tracks.shoe_loads, 0.5 * shape.axle_distance, 0.5 * shape.shoe_thickness,
        heights,
    )  # fmt: skip
    return heights


@kernel
def _mean_sole_heights(poses, loads, half, thick, heights):  # type: ignore[no-untyped-def]
    """See `sole_heights`: the mean by load of those between the axles, `half` from the middle."""
    for side in range(2):
        total = height = 0.0
        for k in range(poses.shape[1]):
            if abs(poses[side, k, 0]) < half:
                total += loads[side, k]
                height += (poses[side, k, 1] - thick) * loads[side, k]
        heights[side] = height / max(total, 1.0)


def standing_pose(
    spec: MachineSpec, ground: Ground, x: float, y: float, yaw: float
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
    along, across = _footprint(spec.tracks)
    c, s = math.cos(yaw), math.sin(yaw)
    at = np.column_stack([x + c * along - s * across, y + s * along + c * across])
    heights = np.array(
        [surface_at(ground.undisturbed_surface, *ground.frame, *point)[0] for point in at]
    )
    fit = np.linalg.lstsq(
        np.column_stack([np.ones_like(along), along, across]), heights, rcond=None
    )[0]
    forward = np.array([c, s, fit[1]])
    leftward = np.array([-s, c, fit[2]])
    normal = np.cross(forward, leftward)
    normal /= np.linalg.norm(normal)
    forward /= np.linalg.norm(forward)
    rotation = np.column_stack([forward, np.cross(normal, forward), normal])
    sink = _sinkage(spec, ground, at, spec.mass * GRAVITY * float(normal[2]))
    return np.array([x, y, fit[0]]) - sink * normal, rotation


def _sinkage(spec: MachineSpec, ground: Ground, points: Array, weight: float) -> float:
    """How deep tracks sink under a weight [N] into what the ground is of at some points [m].

    As deep as the contact's springs, or Bekker's pressure where that is deeper; no deeper than the
    wheels are large.
    """
    shape = spec.tracks
    carrying = 2.0 * shape.axle_distance / shape.pitch  # shoes
    springs = weight / (carrying * shape.normal_stiffness)
    pressure = weight / (2.0 * shape.axle_distance * shape.shoe_width)
    grid = ground.grid
    row = np.clip(np.rint(grid.row(points[:, 0])), 0, grid.rows - 1).astype(np.int64)
    col = np.clip(np.rint(grid.col(points[:, 1])), 0, grid.cols - 1).astype(np.int64)
    soil, moisture = ground.soil[row, col], ground.moisture[row, col]
    laws = soil_coefficients(ground.soils, shape.shoe_width)[soil, moisture]
    depths = [
        max((pressure / modulus) ** (1.0 / exponent), springs) if modulus else springs
        for modulus, exponent in laws[:, :2].tolist()
    ]
    return min(float(np.mean(depths)), shape.sprocket_radius)


def _footprint(shape: TrackSpec) -> tuple[Array, Array]:
    """Points under both tracks [m], base frame: x and y, each shape (n,)."""
    half = 0.5 * shape.axle_distance
    sides = [
        0.5 * side * (shape.gauge + edge * shape.shoe_width) for side in (1, -1) for edge in (1, -1)
    ]
    along, across = np.meshgrid(np.linspace(-half, half, 9), sides)
    return along.ravel(), across.ravel()


def hull_corners(spec: MachineSpec) -> Array:
    """Corners of the hull's first box with its joint at 0 [m], base frame, shape (8, 3)."""
    boxes = spec.links[spec.main_body].boxes
    if not boxes:
        return np.zeros((0, 3))
    origins = [j.origin for j in spec.joints.values() if j.child == spec.main_body]
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    corners = np.array(boxes[0].center) + 0.5 * signs * np.array(boxes[0].size)
    return np.asarray(corners + np.array(origins or [(0.0, 0.0, 0.0)]), dtype=np.float64)
