"""Initial pose of a machine on the ground."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from machine_sim.ground.contact_surface import Ground, surface_at
from machine_sim.machine.errors import MachineError
from machine_sim.machine.spec import MachineSpec, TrackSpec
from machine_sim.machine.tracks.terramechanics import (
    BEKKER_MODULUS,
    BEKKER_N,
    soil_coefficients,
)
from msg_bridge.contract.constants import GRAVITY
from msg_bridge.contract.grid import Grid

__all__ = ["standing_pose"]

Array = NDArray[np.float64]


def standing_pose(
    spec: MachineSpec, ground: Ground, x: float, y: float, yaw: float
) -> tuple[Array, Array]:
    """Return the pose of the base frame on the ground at (x, y) [m] with a heading `yaw` [rad].

    The tracks stand on the plane of best fit to the ground under them, at the depth to which the
    weight presses them in.

    Returns:
        Position [m], map frame, shape (3,), and rotation matrix base to map, shape (3, 3).

    Raises:
        MachineError: x, y or yaw is not finite, the position is off the map, or the map is smaller
            than the tracks.
    """
    if not all(map(math.isfinite, (x, y, yaw))):
        raise MachineError(f"position ({x}, {y}) and yaw {yaw} of a machine must be finite")
    _check_map_size(spec, ground.grid)
    if not ground.grid.contains(x, y):
        raise MachineError(
            f"({x}, {y}) m is off the map, which ends at {0.5 * ground.grid.size[0]:g},"
            f" {0.5 * ground.grid.size[1]:g} m: place the machine on it"
        )
    forward_offsets, left_offsets = _footprint(spec.tracks)
    c, s = math.cos(yaw), math.sin(yaw)
    points = np.column_stack(
        [x + c * forward_offsets - s * left_offsets, y + s * forward_offsets + c * left_offsets]
    )
    heights = np.array(
        [surface_at(ground.undisturbed_surface, *ground.frame, *point)[0] for point in points]
    )
    height, slope_forward, slope_left = np.linalg.lstsq(
        np.column_stack([np.ones_like(forward_offsets), forward_offsets, left_offsets]),
        heights,
        rcond=None,
    )[0]
    forward = np.array([c, s, slope_forward])
    left = np.array([-s, c, slope_left])
    normal = np.cross(forward, left)
    normal /= np.linalg.norm(normal)
    forward /= np.linalg.norm(forward)
    rotation = np.column_stack([forward, np.cross(normal, forward), normal])
    sinkage = _static_sinkage(spec, ground, points, spec.mass * GRAVITY * float(normal[2]))
    return np.array([x, y, height]) - sinkage * normal, rotation


def _check_map_size(spec: MachineSpec, grid: Grid) -> None:
    """Check that the tracks fit on the map in some heading: beyond its edge there is no soil."""
    tracks = spec.tracks
    length = tracks.axle_distance + 2.0 * tracks.sprocket_radius
    width = tracks.gauge + tracks.shoe_width
    needed, size = sorted((length, width)), sorted(grid.size)
    if size[0] < needed[0] or size[1] < needed[1]:
        raise MachineError(
            f"the map is {grid.size[0]:g} x {grid.size[1]:g} m, and the tracks of {spec.name} take"
            f" {length:.1f} x {width:.1f} m; give a larger terrain: increase site.num_points or"
            " site.cell of the soil node, or take a larger file"
        )


def _static_sinkage(spec: MachineSpec, ground: Ground, points: Array, weight: float) -> float:
    """Return the depth to which tracks sink under a weight [N], mean over some points [m].

    It is the larger of the deflection of the contact springs and the depth at which Bekker's
    pressure carries the weight, and at most the radius of the wheels.
    """
    tracks = spec.tracks
    num_loaded_shoes = 2.0 * tracks.axle_distance / tracks.pitch
    deflection = weight / (num_loaded_shoes * tracks.normal_stiffness)
    pressure = weight / (2.0 * tracks.axle_distance * tracks.shoe_width)
    grid = ground.grid
    row = np.clip(np.rint(grid.row(points[:, 0])), 0, grid.rows - 1).astype(np.int64)
    col = np.clip(np.rint(grid.col(points[:, 1])), 0, grid.cols - 1).astype(np.int64)
    table = soil_coefficients(ground.soils, tracks.shoe_width)
    coefficients = table[ground.soil[row, col], ground.moisture[row, col]]
    depths = [
        max((pressure / modulus) ** (1.0 / exponent), deflection) if modulus else deflection
        for modulus, exponent in coefficients[:, [BEKKER_MODULUS, BEKKER_N]].tolist()
    ]
    return min(float(np.mean(depths)), tracks.sprocket_radius)


def _footprint(tracks: TrackSpec) -> tuple[Array, Array]:
    """Return points under both tracks [m], base frame: x and y, shape (n,) each."""
    half = 0.5 * tracks.axle_distance
    edges = [
        0.5 * side * (tracks.gauge + edge * tracks.shoe_width)
        for side in (1, -1)
        for edge in (1, -1)
    ]
    forward, left = np.meshgrid(np.linspace(-half, half, 9), edges)
    return forward.ravel(), left.ravel()
