"""Force of soil on a wide blade, by the fundamental earthmoving equation.

    P / w = gamma d^2 N_gamma + c d N_c + q d N_q + c_a d N_a

(Reece, The fundamental equation of earth-moving mechanics, Proc. Inst. Mech. Eng. 179 (3F), 1964;
the factors are of a plane wedge: McKyes, Soil Cutting and Tillage, Elsevier, 1985.)

A blade of width w cuts to depth d in soil of unit weight gamma (density times g), internal friction
phi and cohesion c, under a surcharge q. Its face rises at the rake angle rho from the horizontal,
measured on the side of the tool: below 90 deg it leans back and lifts the soil, at 90 deg it is
vertical, above 90 deg it leans over the soil. Friction delta and adhesion c_a act between
soil and face. A wedge of soil slides up a plane that starts at the edge at the angle beta. The
blade pushes the soil with P, inclined by delta to the normal of its face, and with the adhesion
along the face.

With x forward, z up, per unit of width, the forces on the wedge are

    blade     P (sin(rho + delta), cos(rho + delta)) + c_a d (cot rho, -1)
    ground    R (-sin(beta + phi), cos(beta + phi)) - c d (cot beta, 1)
    weight    (0, -(gamma d^2 / 2 + q d) (cot rho + cot beta))

and balance, R eliminated, gives

    D       = cos(rho + delta) + sin(rho + delta) cot(beta + phi)
    N_gamma = (cot rho + cot beta) / (2 D)            N_q = 2 N_gamma
    N_c     = (1 + cot beta cot(beta + phi)) / D
    N_a     = (1 - cot rho cot(beta + phi)) / D

N_a is negative where rho + beta + phi < 90 deg: on a flat blade the adhesion carries part of the
wedge. The force against the travel still increases with it, by c_a d cos(delta) / (sin(rho) D). The
adhesion is limited to the value at which it carries the whole wedge and P is 0, because soil cannot
pull at a face.

beta minimizes N_gamma. With Omega = rho + delta + phi and y = cos(Omega) +
cot(beta) sin(Omega), N_gamma is the sum of a constant, a multiple of y and a multiple of 1 / y.
Its minimum is at

    y^2 = sin(phi + delta) sin(rho + delta) / (sin(rho) sin(phi))

which is Coulomb's passive earth pressure. No search is needed.

Limits of the theory:

- For Omega near 180 deg there is no wedge, and the rake is clamped to the value where Omega is
  `MAX_ANGLE_SUM` (102 deg in the loam below). The plane wedge overestimates the force already
  below; forces on tools have a factor for that (`curved_failure`), which this equation has not.
- Below `MIN_RAKE` the face under the wedge would be longer than that of a tool: the rake is clamped
  to `MIN_RAKE`.
- If the face is rougher than the soil, the soil fails next to it: delta is clamped to phi. Clay
  without friction therefore has a finite force, too.
- The equation is of a wide blade on level ground. `failure_wedge` has the general case: a surface
  that slopes, and soil that fails beside the ends of the blade.

A bucket in loam (w 1.2 m, d 0.2 m, gamma 16 kN/m^3, phi 35 deg, delta 23 deg, c 10 kPa, c_a 2 kPa,
rho 60 deg) gives beta = 26.5 deg and

    =========  ======  =======
    term       factor  P [kN]
    =========  ======  =======
    weight     1.9545     1.50
    cohesion   3.1616     7.59
    adhesion   1.0388     0.50
    =========  ======  =======

P = 9.59 kN; with the adhesion along the face, 9.79 kN against the travel and 0.69 kN down.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from msg_bridge.kernels import kernel
from soil_sim.errors import SoilError
from soil_sim.tool_force.failure_wedge import (
    MAX_ANGLE_SUM,
    MAX_FRICTION,
    MIN_RAKE,
    clamp_angles,
    wedge_force,
)

__all__ = [
    "MAX_ANGLE_SUM",
    "MAX_FRICTION",
    "MIN_RAKE",
    "BladeForce",
    "WedgeFactors",
    "blade_force",
    "compute_blade_force",
    "wedge_factors",
]


@dataclass(frozen=True)
class WedgeFactors:
    """Soil wedge in front of a blade; it depends on angles only.

    Attributes:
        rake: rake [rad], clamped to the limits of the theory.
        beta: angle of the failure plane to the horizontal [rad].
        n_gamma, n_c, n_q, n_a: factors of weight, cohesion, surcharge and adhesion [-].
    """

    rake: float
    beta: float
    n_gamma: float
    n_c: float
    n_q: float
    n_a: float

    @classmethod
    def from_angles(cls, rake: float, phi: float, delta: float) -> WedgeFactors:
        """Return the factors of a blade.

        Args:
            rake: rake of the blade [rad], in (0, pi); see the module for how it is clamped.
            phi: angle of internal friction [rad], in [0, `MAX_FRICTION`].
            delta: angle of soil-tool friction [rad], in [0, pi / 2); clamped to phi.

        Raises:
            SoilError: an angle is out of range.
        """
        _check_angles(rake, phi, delta)
        return cls(*wedge_factors(rake, phi, delta))


@dataclass(frozen=True)
class BladeForce:
    """Force of the soil on a blade that cuts it.

    Attributes:
        horizontal: force against the travel [N], 0 or more.
        vertical: upward force [N]; a negative one pulls the blade into the ground.
    """

    horizontal: float
    vertical: float


def compute_blade_force(
    *,
    width: float,
    depth: float,
    rake: float,
    gamma: float,
    phi: float,
    delta: float,
    cohesion: float = 0.0,
    adhesion: float = 0.0,
    surcharge: float = 0.0,
    slope: float = 0.0,
    num_ends: float = 0.0,
) -> BladeForce:
    """Return the force of the soil on a blade: `wedge_force` with validated arguments.

    With the defaults of `slope` and `num_ends` that of the fundamental earthmoving equation, a wide
    blade in level ground; see `failure_wedge` for the general case.

    Args:
        width: width of the blade [m].
        depth: depth of its edge below the surface [m].
        rake: rake of the blade [rad], in (0, pi); see the module for how it is clamped.
        gamma: unit weight of the soil, density times g [N/m³].
        phi: angle of internal friction [rad], in [0, `MAX_FRICTION`].
        delta: angle of soil-tool friction [rad], in [0, pi / 2); clamped to phi.
        cohesion: cohesion of the soil [Pa].
        adhesion: adhesion of the soil to the tool [Pa]; limited to the value at which P is 0.
        surcharge: pressure on the surface in front of the blade [Pa].
        slope: angle of the surface in front of the blade to the horizontal [rad], positive if it
            rises; clamped to the limits of the theory.
        num_ends: number of ends of the blade beside which soil fails, 0 to 2.

    Raises:
        SoilError: an angle is out of range, or another argument is negative or not finite.
    """
    _check_angles(rake, phi, delta)
    for name, value, unit in (
        ("width", width, "m"),
        ("depth", depth, "m"),
        ("gamma", gamma, "N/m³"),
        ("cohesion", cohesion, "Pa"),
        ("adhesion", adhesion, "Pa"),
        ("surcharge", surcharge, "Pa"),
    ):
        if not 0.0 <= value < math.inf:
            raise SoilError(f"{name} is {value} {unit}; give a finite number, 0 or more")
    if not abs(slope) < math.pi / 2:
        raise SoilError(f"slope is {slope} rad; give an angle within -pi/2 and pi/2, in radians")
    if not 0.0 <= num_ends <= 2.0:
        raise SoilError(f"num_ends is {num_ends}; a blade has 0 to 2 ends")
    return BladeForce(
        *_wedge_force(
            width, num_ends, depth, rake, slope, surcharge, gamma, phi, delta, cohesion, adhesion
        )
    )


def _check_angles(rake: float, phi: float, delta: float) -> None:
    if not 0.0 < rake < math.pi:
        raise SoilError(f"rake is {rake} rad; give an angle between 0 and pi, in radians")
    if not 0.0 <= phi <= MAX_FRICTION:
        raise SoilError(f"phi is {phi} rad; give an angle from 0 to {MAX_FRICTION:.3f}, in radians")
    if not 0.0 <= delta < math.pi / 2:
        raise SoilError(f"delta is {delta} rad; give an angle from 0 to below pi/2, in radians")


@kernel
def wedge_factors(rake, phi, delta):  # type: ignore[no-untyped-def]
    """Return (clamped rake, beta, N_gamma, N_c, N_q, N_a); angles in rad.

    Kernel. Angles are clamped: phi to [0, `MAX_FRICTION`], delta to [0, phi], the rake between
    `MIN_RAKE` and the value where Omega is `MAX_ANGLE_SUM`. NaN gives NaN.
    """
    rake, phi, delta = clamp_angles(rake, phi, delta)
    angle_sum = rake + delta + phi
    cot_rake = math.cos(rake) / math.sin(rake)
    # Without friction N_gamma does not depend on beta: take the limit of a smooth face.
    friction = 1.0 if phi == 0.0 else math.sin(phi + delta) / math.sin(phi)
    y = math.sqrt(friction * math.sin(rake + delta) / math.sin(rake))
    cot_beta = (y - math.cos(angle_sum)) / math.sin(angle_sum)
    # D = y / along, and cot(beta + phi) = across / along.
    along = math.cos(phi) + cot_beta * math.sin(phi)
    across = cot_beta * math.cos(phi) - math.sin(phi)
    n_q = (cot_rake + cot_beta) * along / y
    n_c = (along + cot_beta * across) / y
    n_a = (along - cot_rake * across) / y
    return rake, math.atan2(1.0, cot_beta), 0.5 * n_q, n_c, n_q, n_a


@kernel
def blade_force(width, depth, rake, surcharge, gamma, phi, delta, cohesion, adhesion):  # type: ignore[no-untyped-def]
    """Return the (horizontal, vertical) force [N] of the soil on a blade, as in `BladeForce`.

    Kernel. Arguments are those of `compute_blade_force`, not validated: angles are clamped as in
    `wedge_factors`, a depth or width of 0 or less gives no force, NaN gives NaN.
    """
    return wedge_force(
        width, 0.0, 0.0, depth, rake, 0.0, surcharge, gamma, phi, delta, cohesion, adhesion
    )


@kernel
def _wedge_force(  # type: ignore[no-untyped-def]
    width, num_ends, depth, rake, slope, surcharge, gamma, phi, delta, cohesion, adhesion
):
    """Return `wedge_force` of a whole blade."""
    ends = num_ends / max(width, 1e-9)
    return wedge_force(
        width, num_ends, ends, depth, rake, slope, surcharge, gamma, phi, delta, cohesion, adhesion
    )
