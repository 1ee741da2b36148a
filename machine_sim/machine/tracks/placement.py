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

_MAX_NEWTON_STEPS = 100
"""Newton steps to the equilibrium; about ten are needed."""

_MAX_SURPLUS = 1e-6
"""Maximum imbalance of forces and moments [m] at the equilibrium, as a fraction of the weight."""

_RIDGE = 1e-3
"""Stiffness that all points add to that of the touching ones, so that any of them are enough."""


def standing_pose(
    spec: MachineSpec, ground: Ground, x: float, y: float, yaw: float
) -> tuple[Array, Array]:
    """Return the pose of the base frame on the ground at (x, y) [m] with a heading `yaw` [rad].

    The tracks stand on the plane of best fit to the ground under them, at the depth to which the
    weight presses them in. Rigid ground would throw off tracks that are in it: where some of the
    ground is rigid, they stand in static equilibrium.

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
    basis = np.column_stack([np.ones_like(forward_offsets), forward_offsets, left_offsets])
    plane = np.linalg.lstsq(basis, heights, rcond=None)[0]
    rotation = _rotation(plane, yaw)
    normal = rotation[:, 2]
    depths, is_rigid = _static_depths(spec, ground, points, spec.mass * GRAVITY * float(normal[2]))
    if is_rigid.any():
        plane = _equilibrium_plane(plane, basis, heights, depths)
        return np.array([x, y, plane[0]]), _rotation(plane, yaw)
    sinkage = min(float(np.mean(depths)), spec.tracks.sprocket_radius)
    return np.array([x, y, plane[0]]) - sinkage * normal, rotation


def _rotation(plane: Array, yaw: float) -> Array:
    """Return the rotation matrix base to map of a machine on a plane, with a heading [rad].

    Args:
        plane: height [m], slopes forward and to the left, shape (3,).
        yaw: heading, counter-clockwise from +x.
    """
    c, s = math.cos(yaw), math.sin(yaw)
    forward = np.array([c, s, plane[1]])
    left = np.array([-s, c, plane[2]])
    normal = np.cross(forward, left)
    normal /= np.linalg.norm(normal)
    forward /= np.linalg.norm(forward)
    return np.column_stack([forward, np.cross(normal, forward), normal])


def _equilibrium_plane(plane: Array, basis: Array, heights: Array, depths: Array) -> Array:
    """Return the plane on which the forces of the ground carry the weight, in the middle.

    Each point is a spring that carries its share of the weight at its depth and does not pull. The
    equilibrium is the minimum of a convex energy, by Newton's method with a line search.

    Args:
        plane: first guess: height [m], slopes forward and to the left, shape (3,).
        basis: 1 and the offsets forward and to the left [m] of each point, shape (n, 3).
        heights: ground at the points [m], shape (n,).
        depths: depth of each point under its share of the weight [m], shape (n,).
    """
    weight = float(len(heights))  # in shares
    transposed = basis.T / depths  # forces and moments of the points by their depth
    ridge = _RIDGE * transposed @ basis

    def energy(plane: Array) -> float:
        penetration = np.maximum(heights - basis @ plane, 0.0)
        return float(0.5 * (penetration / depths) @ penetration + weight * plane[0])

    for _ in range(_MAX_NEWTON_STEPS):
        penetration = np.maximum(heights - basis @ plane, 0.0)
        surplus = transposed @ penetration - [weight, 0.0, 0.0]
        if np.abs(surplus).max() < _MAX_SURPLUS * weight:
            break
        touching = penetration > 0.0
        step = np.linalg.solve(ridge + transposed[:, touching] @ basis[touching], surplus)
        before = energy(plane)
        while energy(plane + step) > before:
            step *= 0.5
        plane = plane + step
    return plane


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


def _static_depths(
    spec: MachineSpec, ground: Ground, points: Array, weight: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Return the depth [m] at which each point carries its share of a weight [N].

    It is the larger of the deflection of the contact springs and the depth at which Bekker's
    pressure carries the weight.

    Returns:
        Depths, and whether the ground is rigid, shape (n,) each.
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
    return np.array(depths), coefficients[:, BEKKER_MODULUS] == 0.0


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
