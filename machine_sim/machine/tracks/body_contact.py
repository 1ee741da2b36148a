"""Contact of the main body with the ground: supports a machine that has overturned.

Each corner of the main body's first box is a contact point with a spring and damper along the
normal and a bristle along the surface, limited by Coulomb friction.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.ground.contact_surface import Ground
from machine_sim.machine.spec import MachineSpec
from machine_sim.machine.tracks.bristle_contact import bristle_force, contact_depth, limit_bristle
from machine_sim.machine.tracks.rigid_body import (
    add_wrench,
    base_frame,
    dot,
    point_velocity,
    to_map,
)
from machine_sim.machine.tracks.track_state import (
    ContactCoefficients,
    ContactPoints,
    TrackDimensions,
)
from msg_bridge.kernels import helper, kernel

__all__ = ["MainBody", "add_body_contact", "body_contact", "main_body_on"]

Array = NDArray[np.float64]


class MainBody(NamedTuple):
    """Main body of a machine, as far as it can touch the ground.

    Attributes:
        corners: corners of the box at joint angle 0 [m], base frame, shape (n, 3).
        surface: contact surface of the ground [m], shape (rows, cols).
        frame: `Ground.frame`.
        anchors, is_active, shear_displacement: `ContactPoints` of the corners.
    """

    corners: Array
    surface: Array
    frame: tuple[float, float, float]
    anchors: Array
    is_active: NDArray[np.bool_]
    shear_displacement: Array


def main_body_on(ground: Ground, spec: MachineSpec) -> MainBody:
    """Return the main body of a machine without contact; it shares the surface of `ground`."""
    corners = _box_corners(spec)
    points = ContactPoints.inactive(len(corners))
    return MainBody(corners, ground.surface, ground.frame, *points)


def _box_corners(spec: MachineSpec) -> Array:
    """Return the corners of the main body's first box at joint angle 0, shape (8, 3) or (0, 3)."""
    boxes = spec.links[spec.main_body].boxes
    if not boxes:
        return np.zeros((0, 3))
    origins = [j.origin for j in spec.joints.values() if j.child == spec.main_body]
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    corners = np.array(boxes[0].center) + 0.5 * signs * np.array(boxes[0].size)
    return np.asarray(corners + np.array(origins or [(0.0, 0.0, 0.0)]), dtype=np.float64)


@kernel
def body_contact(motion, swing, dimensions, body, coefficients, wrench):  # type: ignore[no-untyped-def]
    """Write the ground's wrench on the main body, see `add_body_contact`.

    The structures are plain tuples with the elements of the named ones; see `track_state`.

    Args:
        motion: packed motion of the base, see `base_motion`.
        swing: cosine and sine of the angle of the main body's joint.
        dimensions: `TrackDimensions`.
        body: `MainBody`; its contact points are updated.
        coefficients: `ContactCoefficients` of a corner.
        wrench: out, force [N] and torque about the base's centre of mass [N m], map frame.
    """
    dimensions = TrackDimensions(*dimensions)
    body, coefficients = MainBody(*body), ContactCoefficients(*coefficients)
    wrench[:] = 0.0
    add_body_contact(base_frame(motion), swing, dimensions.base_com, body, coefficients, wrench)


@helper(forceinline=True)
def add_body_contact(base, swing, base_com, body, coefficients, wrench):  # type: ignore[no-untyped-def]
    """Add the ground's forces on the corners of the main body to a wrench.

    Args:
        base: `BaseFrame`.
        swing: cosine and sine of the angle of the main body's joint.
        base_com: centre of mass of the base [m], base frame.
        body: `MainBody`; its contact points are updated.
        coefficients: `ContactCoefficients` of a corner.
        wrench: force [N] and torque about the base's centre of mass [N m], map frame; updated.
    """
    points = ContactPoints(body.anchors, body.is_active, body.shear_displacement)
    swing_cos, swing_sin = swing
    corners = body.corners
    for k in range(len(corners)):
        local = (
            corners[k, 0] * swing_cos - corners[k, 1] * swing_sin - base_com[0],
            corners[k, 0] * swing_sin + corners[k, 1] * swing_cos - base_com[1],
            corners[k, 2] - base_com[2],
        )
        arm = to_map(base.rotation, local)
        cx, cy, cz = base.center_of_mass
        point = (cx + arm[0], cy + arm[1], cz + arm[2])
        velocity = point_velocity(base.velocity, base.angular_velocity, arm)
        force, load = _corner_force(point, velocity, coefficients, body, points, k)
        if load > 0.0:
            add_wrench(wrench, force, arm)


@helper(forceinline=True)
def _corner_force(point, velocity, coefficients, body, points, i):  # type: ignore[no-untyped-def]
    """Return the ground's force on a corner (fx, fy, fz) [N], and its normal load [N]."""
    depth, normal = contact_depth(body.surface, body.frame, point)
    if not depth > 0.0:
        points.is_active[i] = False
        return (0.0, 0.0, 0.0), 0.0
    load = coefficients.normal_stiffness * depth - coefficients.normal_damping * dot(
        velocity, normal
    )
    if not load > 0.0:  # the corner rises faster than the soil can follow
        points.is_active[i] = False
        return (0.0, 0.0, 0.0), 0.0
    force, _ = bristle_force(point, velocity, normal, coefficients, points, i)
    limit = coefficients.friction * load
    (fx, fy, fz), _ = limit_bristle(point, force, limit, coefficients, points, i)
    nx, ny, nz = normal
    return (fx + load * nx, fy + load * ny, fz + load * nz), load
