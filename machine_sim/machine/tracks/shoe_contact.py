"""Contact of a track shoe with the ground, common to both track models.

Each shoe touches the ground at a few contact points. The force on one of them is the sum of a
normal force (Bekker's pressure on deformable soil, a spring on rigid ground, and a damper) and the
force of its bristle, limited by the shear strength of the soil and the friction of the sole.
"""

from __future__ import annotations

from machine_sim.machine.tracks.bristle_contact import bristle_force, contact_depth, limit_bristle
from machine_sim.machine.tracks.rigid_body import dot
from machine_sim.machine.tracks.terramechanics import (
    BEKKER_MODULUS,
    BEKKER_N,
    COHESION,
    JANOSI_K,
    TAN_FRICTION,
    bearing_force,
    nearest_cell,
    shear_strength,
)
from msg_bridge.kernels import helper

__all__ = [
    "CONTACT_WIDTH_FRACTION",
    "MAX_OUTWARD_Z",
    "mean_depth",
    "normal_load",
    "shear_force",
    "sole_force",
]

CONTACT_WIDTH_FRACTION = 0.9
"""Lateral distance of the contact points from the middle of the shoe, in half widths."""

MAX_OUTWARD_Z = 0.3
"""Maximum z (map frame) of the outward normal of a shoe that can touch the ground."""


@helper(forceinline=True)
def sole_force(point, attachment, velocity, coefficients, area, soil, points, i):  # type: ignore[no-untyped-def]
    """Return the ground's force on a contact point of a sole.

    Args:
        point: position of the point [m], map frame.
        attachment: position where the bristle is attached to the sole [m], map frame; the point,
            unless that moves along the sole.
        velocity: velocity of the sole at the point [m/s], map frame.
        coefficients: `ContactCoefficients`.
        area: area of the sole that the point stands for [m^2].
        soil: `SoilPatch`; its `max_sinkage` is updated.
        points: `ContactPoints`; updated.
        i: index of the point.

    Returns:
        Force (fx, fy, fz) [N], map frame, normal load [N] and depth [m]; zeros without contact.
    """
    load, depth, normal = normal_load(point, velocity, coefficients, area, soil)
    if not load > 0.0:
        points.is_active[i] = False
        return (0.0, 0.0, 0.0), 0.0, 0.0
    (fx, fy, fz), (nx, ny, nz) = (
        shear_force(point, attachment, velocity, normal, load, coefficients, area, soil, points, i),
        normal,
    )
    return (fx + load * nx, fy + load * ny, fz + load * nz), load, depth


@helper(forceinline=True)
def normal_load(point, velocity, coefficients, area, soil):  # type: ignore[no-untyped-def]
    """Return the ground's normal force on a contact point [N], its depth [m] and the unit normal.

    Args:
        point, velocity, coefficients, area, soil: as for `sole_force`.

    Returns:
        Load, depth and normal (map frame); load and depth are 0 without contact.
    """
    depth, normal = contact_depth(soil.undisturbed_surface, soil.frame, point)
    if not depth > 0.0:
        return 0.0, 0.0, normal
    row, col = nearest_cell(soil, point)
    kind, moisture, table = soil.soil[row, col], soil.moisture[row, col], soil.coefficients
    stiffness, max_depth = coefficients.normal_stiffness, 0.0
    spring = stiffness * depth
    if spring > coefficients.max_stiff_load:
        residual = coefficients.residual_stiffness
        spring = coefficients.max_stiff_load * (1.0 - residual / stiffness) + residual * depth
    modulus = table[kind, moisture, BEKKER_MODULUS]
    is_deformable = modulus > 0.0
    if is_deformable:
        max_depth = max(depth, soil.max_sinkage[row, col])
        spring = bearing_force(
            depth, max_depth, area, stiffness, (modulus, table[kind, moisture, BEKKER_N])
        )
    load = spring - coefficients.normal_damping * dot(velocity, normal)
    if not (spring > 0.0 and load > 0.0):  # the sole rises faster than the soil can follow
        return 0.0, 0.0, normal
    if is_deformable:
        soil.max_sinkage[row, col] = max_depth
    return load, depth, normal


@helper(forceinline=True)
def shear_force(  # type: ignore[no-untyped-def]
    point, attachment, velocity, normal, load, coefficients, area, soil, points, i
):
    """Return the ground's force on a loaded contact point along the ground [N], map frame.

    Args:
        point, attachment, velocity, coefficients, area, soil, points, i: as for `sole_force`.
        normal: unit normal of the ground, map frame.
        load: normal load [N].
    """
    row, col = nearest_cell(soil, point)
    kind, moisture, table = soil.soil[row, col], soil.moisture[row, col], soil.coefficients
    force, deflection = bristle_force(attachment, velocity, normal, coefficients, points, i)
    max_force, displacement = coefficients.friction * load, 0.0
    if table[kind, moisture, BEKKER_MODULUS] > 0.0:
        displacement = points.shear_displacement[i] + deflection
        max_force = shear_strength(
            displacement,
            load,
            area,
            max_force,
            (
                table[kind, moisture, COHESION],
                table[kind, moisture, TAN_FRICTION],
                table[kind, moisture, JANOSI_K],
            ),
        )
    force, is_sliding = limit_bristle(attachment, force, max_force, coefficients, points, i)
    if is_sliding:
        elastic = max_force / coefficients.tangential_stiffness
        points.shear_displacement[i] = max(displacement - elastic, 0.0)
    return force


@helper(forceinline=True)
def mean_depth(load_depth, load):  # type: ignore[no-untyped-def]
    """Return the mean depth by load [m], from the sums of load times depth [N m] and load [N]."""
    return load_depth / load if load > 0.0 else 0.0
