"""Force of rock on a conical (point-attack) pick that cuts it.

Two theories give the peak cutting force of a sharp pick that cuts a symmetric groove of depth d in
intact rock (unrelieved cutting). theta is the full angle of the cone at its tip, sigma_t and
sigma_c are the tensile and the uniaxial compressive strength of the rock.

Evans (A theory of the cutting force for point-attack picks, Int. J. Mining Eng. 2, 1984, 63-71):

    FC = 16 pi sigma_t^2 d^2 / (cos^2(theta / 2) sigma_c)

It has no friction, and its force does not tend to zero with the cone angle.

Goktan (A suggested improvement on Evans' cutting theory for conical bits, Proc. 4th Int. Symp. on
Mine Mechanization and Automation, Brisbane, 1997, vol. 1, A4-57 to A4-61), with the angle of
friction psi between pick and rock; sigma_c drops out:

    FC = 4 pi sigma_t d^2 sin^2(theta / 2 + psi) / cos(theta / 2 + psi)

Both are as quoted by Goktan and Gunes (J. South. Afr. Inst. Min. Metall. 105, 2005, 257-263), which
also finds that neither predicts an asymmetric attack well: they give the order of magnitude. The
mean force over a cut is a fraction of the peak.

Neither theory gives the normal force FN, which pushes the pick out of the rock. It is FC times a
ratio, a parameter: measured ratios of conical picks are around one and increase with wear.

With d = 10 mm, theta = 80 deg, psi = 10 deg, sigma_t = 5 MPa, sigma_c = 80 MPa, Evans gives 2.68 kN
and Goktan 5.74 kN.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from msg_bridge.kernels import kernel
from soil_sim.errors import SoilError

__all__ = ["PickForce", "evans_force", "goktan_force", "pick_force"]


@dataclass(frozen=True)
class PickForce:
    """Peak force of the rock on a pick.

    Attributes:
        cutting: force against the travel [N].
        normal: force out of the rock, perpendicular to its surface [N].
    """

    cutting: float
    normal: float


def pick_force(
    *,
    depth: float,
    tip_angle: float,
    tensile_strength: float,
    compressive_strength: float,
    friction: float = math.radians(10.0),
    normal_ratio: float = 1.0,
    model: Literal["evans", "goktan"] = "goktan",
) -> PickForce:
    """Return the peak force of rock on a pick, from validated arguments.

    Args:
        depth: depth of the cut [m].
        tip_angle: full angle of the cone, theta [rad], in (0, pi).
        tensile_strength: tensile strength of the rock [Pa], above 0.
        compressive_strength: uniaxial compressive strength of the rock [Pa], above the tensile
            strength; without effect in Goktan's model.
        friction: angle of friction between pick and rock, psi [rad], 0 or more, with
            theta / 2 + psi below pi / 2; without effect in Evans' model.
        normal_ratio: normal force over cutting force, FN / FC [-].
        model: theory of Evans or of Goktan.

    Raises:
        SoilError: a value outside its range, or an unknown model.
    """
    if not 0.0 <= depth < math.inf:
        raise SoilError(f"depth is {depth} m; give a finite depth, 0 or more")
    if not 0.0 < tip_angle < math.pi:
        raise SoilError(f"tip_angle is {tip_angle} rad; give a full angle between 0 and pi")
    if not 0.0 < tensile_strength < compressive_strength < math.inf:
        raise SoilError(
            f"tensile_strength is {tensile_strength} Pa, compressive_strength"
            f" {compressive_strength} Pa; give 0 < tensile < compressive"
        )
    if not 0.0 <= friction < math.pi / 2 - tip_angle / 2:
        raise SoilError(
            f"friction is {friction} rad; give 0 or more, and with half the tip angle"
            f" ({tip_angle / 2} rad) less than pi/2, or the pick crushes and does not cut"
        )
    if not 0.0 <= normal_ratio < math.inf:
        raise SoilError(f"normal_ratio is {normal_ratio}; give a finite number, 0 or more")
    if model == "evans":
        cutting = evans_force(depth, tip_angle, tensile_strength, compressive_strength)
    elif model == "goktan":
        cutting = goktan_force(depth, tip_angle, tensile_strength, friction)
    else:
        raise SoilError(f"model is {model!r}; give 'evans' or 'goktan'")
    return PickForce(cutting, normal_ratio * cutting)


@kernel
def evans_force(depth, tip_angle, tensile, compressive):  # type: ignore[no-untyped-def]
    """Return Evans' peak cutting force [N]; depth in m, angle in rad, strengths in Pa.

    Kernel. Arguments are not validated. A depth of 0 or less gives 0, NaN gives NaN.
    """
    if depth <= 0.0:
        return 0.0
    return 16.0 * math.pi * (tensile * depth / math.cos(0.5 * tip_angle)) ** 2 / compressive


@kernel
def goktan_force(depth, tip_angle, tensile, friction):  # type: ignore[no-untyped-def]
    """Return Goktan's peak cutting force [N]; depth in m, angles in rad, strength in Pa.

    Kernel. Arguments are not validated. A depth of 0 or less gives 0, NaN gives NaN.
    """
    if depth <= 0.0:
        return 0.0
    attack = 0.5 * tip_angle + friction
    return 4.0 * math.pi * tensile * (depth * math.sin(attack)) ** 2 / math.cos(attack)
