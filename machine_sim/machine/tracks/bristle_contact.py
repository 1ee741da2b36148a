"""Kernel helpers for one contact point: depth, bristle force and sliding.

A contact point carries a spring and a damper along the normal of the ground, and a bristle along
its plane: a spring from the point to its anchor, where it first touched. Beyond the limit of the
tangential force the point slides and drags its anchor along (the models of Dahl and LuGre, reduced
to the stiff bristle).
"""

from __future__ import annotations

import math

from machine_sim.ground.contact_surface import surface_at
from machine_sim.machine.tracks.rigid_body import dot
from msg_bridge.kernels import helper

__all__ = ["bristle_force", "contact_depth", "limit_bristle"]


@helper(forceinline=True)
def contact_depth(surface, frame, point):  # type: ignore[no-untyped-def]
    """Return the depth of a point below a surface along its normal [m], and the unit normal.

    Args:
        surface: heights [m], shape (rows, cols).
        frame: `Ground.frame`.
        point: position [m], map frame.
    """
    height, slope_x, slope_y = surface_at(surface, frame[0], frame[1], frame[2], point[0], point[1])
    nz = 1.0 / math.sqrt(1.0 + slope_x * slope_x + slope_y * slope_y)
    return (height - point[2]) * nz, (-slope_x * nz, -slope_y * nz, nz)


@helper(forceinline=True)
def bristle_force(point, velocity, normal, coefficients, points, i):  # type: ignore[no-untyped-def]
    """Return the tangential force of a point's bristle [N], and the bristle's deflection [m].

    A point that was not in contact gets its anchor where it is.

    Args:
        point, velocity: position [m] and velocity [m/s], map frame.
        normal: unit normal of the ground.
        coefficients: `ContactCoefficients`.
        points: `ContactPoints`; updated.
        i: index of the point.
    """
    px, py, pz = point
    vx, vy, vz = velocity
    nx, ny, nz = normal
    anchors = points.anchors
    if not points.is_active[i]:
        points.is_active[i] = True
        anchors[i, 0], anchors[i, 1], anchors[i, 2] = px, py, pz
        points.shear_displacement[i] = 0.0
    ux, uy, uz = px - anchors[i, 0], py - anchors[i, 1], pz - anchors[i, 2]
    un, vn = dot((ux, uy, uz), normal), dot(velocity, normal)
    ux, uy, uz = ux - un * nx, uy - un * ny, uz - un * nz
    kt, ct = coefficients.tangential_stiffness, coefficients.tangential_damping
    force = (
        -kt * ux - ct * (vx - vn * nx),
        -kt * uy - ct * (vy - vn * ny),
        -kt * uz - ct * (vz - vn * nz),
    )
    return force, math.sqrt(ux * ux + uy * uy + uz * uz)


@helper(forceinline=True)
def limit_bristle(point, force, limit, coefficients, points, i):  # type: ignore[no-untyped-def]
    """Limit a tangential force to `limit` [N]; return it and whether the point slides.

    The anchor of a sliding point follows, so that the spring alone gives the limited force.
    """
    fx, fy, fz = force
    magnitude = math.sqrt(fx * fx + fy * fy + fz * fz)
    if not magnitude > limit:
        return (fx, fy, fz), False
    factor = limit / magnitude
    fx, fy, fz = factor * fx, factor * fy, factor * fz
    kt, anchors = coefficients.tangential_stiffness, points.anchors
    anchors[i, 0] = point[0] + fx / kt
    anchors[i, 1] = point[1] + fy / kt
    anchors[i, 2] = point[2] + fz / kt
    return (fx, fy, fz), True
