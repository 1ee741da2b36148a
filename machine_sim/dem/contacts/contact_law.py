"""The contact law: a linear spring and dashpot along the normal, a spring with Coulomb slip across.

Cundall & Strack, Géotechnique 29 (1979) 47-65; Luding, Granular Matter 10 (2008) 235-246,
doi:10.1007/s10035-008-0099-x, sections 2.1-2.2.
Rolling resistance is not of a contact but of a particle: see `bodies.integrate_bodies`.

Stiffness and damping are taken *per unit of effective mass*, so that every pair, large or small,
has the same contact duration and the explicit integration has one limit for all of them.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from msg_bridge.kernels import kernel

__all__ = ["ContactParameters", "contact_force", "contact_force_and_moment", "contact_law"]

ContactParameters = tuple[np.float32, np.float32, np.float32, np.float32, np.float32]
"""Normal stiffness [1/s^2], normal damping [1/s], the same two across, substep [s]."""

_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)
_TINY = np.float32(1e-20)


@lru_cache(maxsize=64)
def contact_law(
    substep: float, substeps_per_contact: float, restitution: float
) -> ContactParameters:
    """Constants of the law for a contact of a given duration.

    The contact duration is half a period of the undamped spring, pi/w0: a bound on stiffness and
    damping alike, whatever the restitution. With b = g/2m the damping rate, w^2 = w0^2 - b^2 and
    x = b/w, the restitution is e = exp(-x (pi - 2 atan x)): the law never pulls, so bodies part
    when the force is zero, not when the spring is at rest (Schwager & Poeschel, Granular Matter 9
    (2007) 465, doi:10.1007/s10035-007-0065-z). Across, stiffness and damping are half of these.

    Args:
        substep: time step of the integration [s].
        substeps_per_contact: how many of them a collision lasts.
        restitution: rebound speed over impact speed, above exp(-2).
    """
    frequency = math.pi / (substep * substeps_per_contact)
    low, high = 0.0, 100.0
    while high - low > 1e-9:
        ratio = 0.5 * (low + high)
        if ratio * (math.pi - 2.0 * math.atan(ratio)) < -math.log(restitution):
            low = ratio
        else:
            high = ratio
    stiffness = frequency**2
    damping = 2.0 * frequency * low / math.sqrt(1.0 + low**2)
    return (
        np.float32(stiffness),
        np.float32(damping),
        np.float32(0.5 * stiffness),
        np.float32(0.5 * damping),
        np.float32(substep),
    )


@kernel(forceinline=True)
def contact_force(contact_params, friction, overlap, nx, ny, nz, vx, vy, vz, sx, sy, sz):  # type: ignore[no-untyped-def]
    """Forces per unit effective mass [m/s^2] on the second body of a contact, without branches.

    Args:
        law: `ContactParameters`.
        friction: Coulomb coefficient.
        overlap: how deep the bodies overlap [m].
        nx, ny, nz: unit normal from the first body to the second.
        vx, vy, vz: velocity of the second's contact point relative to the first's [m/s].
        sx, sy, sz: the tangential spring [m].

    Returns:
        The push along the normal, 0 or more; the three components of the friction, which acts
        against the slip; then the new spring's.
    """
    stiffness, damping, stiffness_t, damping_t, dt = contact_params
    vn = vx * nx + vy * ny + vz * nz
    normal_force = max(stiffness * overlap - damping * vn, _ZERO)
    vx -= vn * nx
    vy -= vn * ny
    vz -= vn * nz
    # The spring is turned back into the tangent plane, which has moved since the last substep.
    sn = sx * nx + sy * ny + sz * nz
    sx += vx * dt - sn * nx
    sy += vy * dt - sn * ny
    sz += vz * dt - sn * nz
    gx = stiffness_t * sx + damping_t * vx
    gy = stiffness_t * sy + damping_t * vy
    gz = stiffness_t * sz + damping_t * vz
    limit = friction * normal_force
    scale = min(limit / np.sqrt(gx * gx + gy * gy + gz * gz + _TINY), _ONE)
    gx *= scale
    gy *= scale
    gz *= scale
    # Where it slips, the spring holds just what friction can.
    inverse = _ONE / stiffness_t
    sx = (gx - damping_t * vx) * inverse
    sy = (gy - damping_t * vy) * inverse
    sz = (gz - damping_t * vz) * inverse
    return normal_force, -gx, -gy, -gz, sx, sy, sz


@kernel(forceinline=True)
def contact_force_and_moment(mass, cohesion_force, normal_force, gx, gy, gz, nx, ny, nz):  # type: ignore[no-untyped-def]
    """What a contact adds up to on its second body.

    Args:
        mass: effective mass [kg], 0 where they do not touch.
        hold: what holds them together [N].
        push, gx, gy, gz: of `contact_force`.
        nx, ny, nz: unit normal from the first body to the second.

    Returns:
        Force [N], its moment about the centre over the radius [N], three components each, and the
        push [N], of which rolling friction is a share.
    """
    normal_force *= mass
    gx *= mass
    gy *= mass
    gz *= mass
    normal = normal_force - cohesion_force
    return (
        normal * nx + gx,
        normal * ny + gy,
        normal * nz + gz,
        gy * nz - gz * ny,
        gz * nx - gx * nz,
        gx * ny - gy * nx,
        normal_force,
    )
