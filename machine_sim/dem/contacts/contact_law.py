"""The contact law: a spring and dashpot along the normal, a spring with Coulomb friction across it.

Linear spring and dashpot: Cundall & Strack, Géotechnique 29 (1979) 47-65. Tangential spring:
Luding, Granular Matter 10 (2008) 235-246, doi:10.1007/s10035-008-0099-x, sections 2.1-2.2. Rolling
resistance is applied once per particle, not per contact: see `integrate.integrate_bodies`.

Stiffness and damping are taken *per unit of effective mass*, so that every pair, large or small,
has the same contact duration and the explicit integration has one stability limit for all of them.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from machine_sim.dem.vec3 import add, cross, dot, scale, subtract
from msg_bridge.kernels import helper

__all__ = ["ContactParameters", "contact_force", "contact_force_and_torque", "contact_parameters"]

_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)
_TINY = np.float32(1e-20)


class ContactParameters(NamedTuple):
    """Constants of the contact law, per unit of effective mass.

    Attributes:
        normal_stiffness: stiffness of the normal spring [1/s^2].
        normal_damping: damping coefficient along the normal [1/s].
        tangential_stiffness: stiffness of the tangential spring [1/s^2].
        tangential_damping: damping coefficient in the tangent plane [1/s].
        substep: time step of the integration [s].
    """

    normal_stiffness: np.float32
    normal_damping: np.float32
    tangential_stiffness: np.float32
    tangential_damping: np.float32
    substep: np.float32


@lru_cache(maxsize=64)
def contact_parameters(
    substep: float, substeps_per_contact: float, restitution: float
) -> ContactParameters:
    """Return the constants of the law for a contact of a given duration.

    The contact duration is half a period of the undamped spring, pi/w0: it bounds stiffness and
    damping, for any restitution. With b = g/2m the damping rate, w^2 = w0^2 - b^2 and x = b/w,
    the restitution is e = exp(-x (pi - 2 atan x)): the contact force is never attractive, so bodies
    separate when the force is zero, not when the spring is relaxed (Schwager & Poeschel, Granular
    Matter 9 (2007) 465, doi:10.1007/s10035-007-0065-z). The equation is solved for x by bisection.
    Tangential stiffness and damping are half of the normal ones.

    Args:
        substep: time step of the integration [s].
        substeps_per_contact: duration of a collision, in substeps.
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
    return ContactParameters(
        normal_stiffness=np.float32(stiffness),
        normal_damping=np.float32(damping),
        tangential_stiffness=np.float32(0.5 * stiffness),
        tangential_damping=np.float32(0.5 * damping),
        substep=np.float32(substep),
    )


@helper(forceinline=True)
def contact_force(params, friction, overlap, normal, velocity, spring):  # type: ignore[no-untyped-def]
    """Return the contact force on the second body per unit of effective mass [m/s^2].

    The function has no branches, so that loops over contacts are vectorised.

    Args:
        params: `ContactParameters`.
        friction: Coulomb friction coefficient.
        overlap: overlap of the bodies [m].
        normal: unit normal from the first body to the second.
        velocity: velocity of the second body's contact point relative to the first's [m/s].
        spring: elongation of the tangential spring [m].

    Returns:
        Normal force, 0 or more; friction force, a vector against the sliding; and the elongation of
        the tangential spring after this substep [m].
    """
    normal_velocity = dot(velocity, normal)
    normal_force = max(
        params.normal_stiffness * overlap - params.normal_damping * normal_velocity, _ZERO
    )
    sliding_velocity = subtract(velocity, scale(normal, normal_velocity))
    # The tangent plane has turned since the last substep: remove the spring's normal part.
    spring_change = subtract(
        scale(sliding_velocity, params.substep), scale(normal, dot(spring, normal))
    )
    spring = add(spring, spring_change)
    drag = add(
        scale(spring, params.tangential_stiffness),
        scale(sliding_velocity, params.tangential_damping),
    )
    limit = friction * normal_force
    drag = scale(drag, min(limit / np.sqrt(dot(drag, drag) + _TINY), _ONE))
    # Where the contact slides, the spring keeps the elongation that balances the Coulomb limit.
    spring = scale(
        subtract(drag, scale(sliding_velocity, params.tangential_damping)),
        _ONE / params.tangential_stiffness,
    )
    friction_force = (-drag[0], -drag[1], -drag[2])
    return normal_force, friction_force, spring


@helper(forceinline=True)
def contact_force_and_torque(mass, cohesion_force, normal_force, friction_force, normal):  # type: ignore[no-untyped-def]
    """Return the force and the torque of a contact on its second body.

    Args:
        mass: effective mass [kg], 0 where the bodies do not touch.
        cohesion_force: attractive force [N].
        normal_force, friction_force: as returned by `contact_force` [m/s^2].
        normal: unit normal from the first body to the second.

    Returns:
        Force [N]; torque about the body's centre over its radius [N]; repulsive normal force [N],
        to which the rolling resistance is proportional.
    """
    normal_force *= mass
    friction_force = scale(friction_force, mass)
    force = add(scale(normal, normal_force - cohesion_force), friction_force)
    return force, cross(friction_force, normal), normal_force
