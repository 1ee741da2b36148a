"""Initial pose of a machine on the ground."""

from __future__ import annotations

import math
from typing import NamedTuple

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

_MIN_DEPTH_RATIO = 1e-3
"""Depth from which the stiffness of the ground counts, as a fraction of that under a share of the
weight: at the surface of soil whose pressure grows with less than the depth it is infinite."""

_RIDGE = 1e-3
"""Stiffness that all points add to that of the touching ones, so that any of them are enough."""


def standing_pose(
    spec: MachineSpec, ground: Ground, x: float, y: float, yaw: float
) -> tuple[Array, Array]:
    """Return the pose of the base frame on the ground at (x, y) [m] with a heading `yaw` [rad].

    The machine stands in static equilibrium, pressed into the ground by its weight.

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
    upright = float(_rotation(plane, yaw)[2, 2])
    carriers = _carriers(spec, ground, points, spec.mass * GRAVITY * upright)
    plane = _equilibrium_plane(plane, basis, heights, carriers)
    return np.array([x, y, plane[0]]), _rotation(plane, yaw)


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


def _equilibrium_plane(plane: Array, basis: Array, heights: Array, carriers: _Carriers) -> Array:
    """Return the plane on which the forces of the ground carry the weight, in the middle.

    The ground does not pull. The equilibrium is the minimum of a convex energy, by Newton's method
    with a line search.

    Args:
        plane: first guess: height [m], slopes forward and to the left, shape (3,).
        basis: 1 and the offsets forward and to the left [m] of each point, shape (n, 3).
        heights: ground at the points [m], shape (n,).
        carriers: how the ground carries at the points.
    """
    depths, exponents = carriers
    weight = float(len(heights))  # in shares
    ridge = _RIDGE * (basis.T / depths) @ basis

    def energy(plane: Array) -> float:
        ratio = np.maximum(heights - basis @ plane, 0.0) / depths
        work = depths * ratio ** (exponents + 1.0) / (exponents + 1.0)
        return float(work.sum() + weight * plane[0])

    for _ in range(_MAX_NEWTON_STEPS):
        ratio = np.maximum(heights - basis @ plane, 0.0) / depths
        surplus = ratio**exponents @ basis - [weight, 0.0, 0.0]
        if np.abs(surplus).max() < _MAX_SURPLUS * weight:
            break
        is_touching = ratio > 0.0
        at_least = np.maximum(ratio, _MIN_DEPTH_RATIO)
        stiffness = np.where(is_touching, exponents * at_least ** (exponents - 1.0) / depths, 0.0)
        step = np.linalg.solve(ridge + (basis.T * stiffness) @ basis, surplus)
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


class _Carriers(NamedTuple):
    """How the ground carries at some points.

    Attributes:
        depths: depth at which a point carries its share of the weight [m], shape (n,).
        exponents: of the depth in the law of the force, shape (n,).
    """

    depths: Array
    exponents: Array


def _carriers(spec: MachineSpec, ground: Ground, points: Array, weight: float) -> _Carriers:
    """Return how the ground carries the points under the tracks, which share a weight [N].

    The law is that of the softer of the contact springs and the soil, whose pressure grows with
    the depth as Bekker states.
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
    moduli, exponents = coefficients[:, [BEKKER_MODULUS, BEKKER_N]].T
    yields = moduli > 0.0  # the ground is not rigid
    sinkages = np.zeros(len(points))
    sinkages[yields] = (pressure / moduli[yields]) ** (1.0 / exponents[yields])
    # A machine does not begin deeper than its wheels, which it could not leave.
    depths = np.clip(sinkages, deflection, tracks.sprocket_radius)
    return _Carriers(depths, np.where(sinkages > deflection, exponents, 1.0))


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
