"""Force on a blade from the soil that it pushes up a failure plane below a sloping surface.

The trial wedge of Coulomb: of all planes through the edge, the soil fails along the one with the
least resistance. The surface ahead rises at the angle epsilon from the horizontal (negative: it
falls), the face of the blade at the rake rho, the plane at beta. Lengths are measured from the
surface: the edge is d' = d cos(epsilon) below it, rho' = rho + epsilon and beta' = beta - epsilon
are the angles of face and plane to it. With k = cot(beta'), per unit of width,

    weight            gamma d'^2 (cot rho' + k) / 2 + q cos(epsilon) d' (cot rho' + k)
    failure plane     cohesion c along d' sqrt(1 + k^2), friction phi
    face              adhesion c_a along d' / sin(rho'), friction delta

and the equilibrium of these forces gives the push P of the blade as a function of
y = sin(rho + delta + phi + beta) / sin(beta'):

    P = P_0 + U y + V / y

with P_0, U and V independent of the plane. So the plane of least resistance is at y = sqrt(V / U),
without a search. On level ground without cohesion it is that of `earthmoving_equation`, and
Coulomb's passive earth pressure. With cohesion, that equation takes the plane of the weight alone
(McKyes, Soil Cutting and Tillage, 1985, ch. 3); its y is kept on level ground, and multiplied on a
slope by the ratio of the least-resistance y there and on level ground. The force is continuous in
epsilon, exact without cohesion, and at most a few per cent above the minimum with it.

**Side crescents.** Beside each end of a blade, soil fails in a crescent: a sector of the same wedge
about the end of the edge, whose radius is the distance r at which the plane reaches the surface and
whose angle eta is given by cos(eta) = cot(rho') / (cot(rho') + k). The soil of both crescents adds
(2/3) r sin(eta) to the width in the term of the weight, and r sin(eta) in those of cohesion and
surcharge (McKyes and Ali, The cutting of soil by narrow blades, J. Terramechanics 14 (2), 1977).
They make a steeper plane the one of least resistance: y is multiplied by the ratio of the y that
minimize the term of the weight with and without crescents.

On steep and rough faces the force is less than that of a plane wedge, see `curved_failure`; see
`earthmoving_equation` for the limits of the angles. epsilon is limited so that rho' and
rho' + delta + phi keep within them, and to -phi below, where soil without cohesion slides without
being pushed.
"""

from __future__ import annotations

import math

from msg_bridge.kernels import helper

__all__ = ["MAX_ANGLE_SUM", "MAX_FRICTION", "MIN_RAKE", "clamp_angles", "wedge_force"]

MIN_RAKE = math.radians(10.0)
"""Minimum rake [rad]; smaller ones are clamped to it."""

MAX_ANGLE_SUM = math.radians(160.0)
"""Maximum rho + delta + phi [rad]; with typical friction beta is 8 to 10 deg there."""

MAX_FRICTION = math.radians(60.0)
"""Maximum angle of internal friction [rad]; materials above it are rock."""


_NUM_NEWTON_STEPS = 4
"""Steps of the search for the plane with crescents; it has converged to 1e-6 after three."""


@helper(forceinline=True)
def clamp_angles(rake, phi, delta):  # type: ignore[no-untyped-def]
    """Return (rake, phi, delta), clamped to the limits of the theory."""
    # min and max would drop a NaN; comparisons do not.
    if phi < 0.0:
        phi = 0.0
    elif phi > MAX_FRICTION:
        phi = MAX_FRICTION
    if delta < 0.0:
        delta = 0.0
    elif delta > phi:
        delta = phi
    if rake < MIN_RAKE:
        rake = MIN_RAKE
    elif rake > MAX_ANGLE_SUM - phi - delta:
        rake = MAX_ANGLE_SUM - phi - delta
    return rake, phi, delta


@helper
def wedge_force(  # type: ignore[no-untyped-def]
    width, num_ends, ends_per_width, depth, rake, slope, surcharge, gamma, phi, delta, cohesion,
    adhesion,
):  # fmt: skip
    """Return the (horizontal, vertical) force [N] of the soil on a blade or a strip of it.

    The horizontal force is against the travel, 0 or more; a negative vertical one pulls the blade
    into the ground.

    Angles are clamped, a depth or width of 0 or less gives no force, NaN gives NaN.

    Args:
        width: width of the strip [m].
        num_ends: number of its ends beside which soil fails in a crescent; a fraction where only
            part of the depth does.
        ends_per_width: the same of the whole blade over its width [1/m]: all strips have one plane.
        depth: vertical depth of the edge below the surface, which is extended to it [m].
        rake: angle of the face to the horizontal [rad].
        slope: angle of the surface ahead to the horizontal [rad], positive if it rises.
        surcharge: pressure on the surface, as weight per horizontal area [Pa].
        gamma, phi, delta, cohesion, adhesion: see `compute_blade_force`.
    """
    if depth <= 0.0 or width <= 0.0:
        return 0.0, 0.0
    rake, phi, delta = clamp_angles(rake, phi, delta)
    slope = _clamp_slope(slope, rake, phi, delta)
    depth *= math.cos(slope)
    surcharge *= math.cos(slope)
    face = rake + slope
    sin_face, cot_face = math.sin(face), math.cos(face) / math.sin(face)
    angle_sum = face + delta + phi
    sin_sum, cos_sum = math.sin(angle_sum), math.cos(angle_sum)
    weight = 0.5 * gamma * depth * depth
    y, a, b, c = _failure_plane(
        rake, slope, phi, delta, weight + surcharge * depth, cohesion * depth, adhesion * depth
    )
    if ends_per_width > 0.0:
        radius_per_y = depth / sin_sum
        swept = math.sqrt(1.0 - _cos_crescent(cot_face, (y - cos_sum) / sin_sum) ** 2)
        y *= _steepening(a, b, c, ends_per_width * radius_per_y * swept / 3.0)
    cot_plane = (y - cos_sum) / sin_sum
    per_weight = (b + a * c + c * y + a * b / y) / (sin_sum * sin_sum)
    per_cohesion = math.cos(phi) * (1.0 / y + y - 2.0 * cos_sum) / (sin_sum * sin_sum)
    turned = face + phi
    per_adhesion = -(cot_plane * math.cos(turned) - math.sin(turned)) / (sin_face * y)
    # The crescents, as additional width.
    radius = depth * (cot_face + cot_plane)
    crescents = num_ends * radius * math.sqrt(1.0 - _cos_crescent(cot_face, cot_plane) ** 2)
    with_weight, with_strength = width + crescents / 3.0, width + crescents / 2.0
    push = weight * per_weight * with_weight + with_strength * depth * (
        surcharge * per_weight + cohesion * per_cohesion
    )
    adhesive = adhesion * depth / sin_face * width  # along the face
    adhesive_push = adhesive * sin_face * per_adhesion
    if push + adhesive_push < 0.0:  # it would carry more than the wedge
        adhesive *= -push / adhesive_push
        push = 0.0
    else:
        push += adhesive_push
    horizontal = push * math.sin(rake + delta) + adhesive * math.cos(rake)
    return horizontal, adhesive * math.sin(rake) - push * math.cos(rake + delta)


@helper(forceinline=True)
def _clamp_slope(slope, rake, phi, delta):  # type: ignore[no-untyped-def]
    """Return the slope of the surface, clamped to the limits of the theory."""
    lowest = max(-phi, MIN_RAKE - rake)
    highest = min(MAX_ANGLE_SUM - rake - delta - phi, math.pi - MIN_RAKE - rake)
    if slope < lowest:
        slope = min(lowest, 0.0)
    elif slope > highest:
        slope = max(highest, 0.0)
    return slope


@helper
def _failure_plane(rake, slope, phi, delta, weight, cohesive, adhesive):  # type: ignore[no-untyped-def]
    """Return y of the failure plane, and the constants a, b, c of the term of the weight.

    Args:
        rake, slope, phi, delta: angles [rad], clamped.
        weight, cohesive, adhesive: sizes of the terms: weight and surcharge, cohesion, adhesion.
    """
    b = math.sin(rake + delta)
    level_a, level_c = math.sin(delta + phi) / math.sin(rake), math.sin(phi)
    # Without friction N_gamma does not depend on the plane: take the limit of a smooth face.
    level_y = math.sqrt(b / math.sin(rake)) if phi == 0.0 else math.sqrt(level_a * b / level_c)
    if slope == 0.0:
        return level_y, level_a, b, level_c
    a, c = math.sin(delta + phi) / math.sin(rake + slope), math.sin(phi + slope)
    cohesive *= math.cos(phi)
    adhesive *= math.cos(delta)
    sin_sum, level_sin_sum = math.sin(rake + slope + delta + phi), math.sin(rake + delta + phi)
    u, level_u = weight * c + cohesive, weight * level_c + cohesive
    v = weight * a * b + cohesive + adhesive * sin_sum / math.sin(rake + slope)
    level_v = weight * level_a * b + cohesive + adhesive * level_sin_sum / math.sin(rake)
    y = level_y
    if u > 0.0 and v > 0.0 and level_u > 0.0 and level_v > 0.0:
        y = level_y * math.sqrt(v / u * (level_u / level_v))
    return y, a, b, c


@helper(forceinline=True)
def _cos_crescent(cot_face, cot_plane):  # type: ignore[no-untyped-def]
    """Return the cosine of the angle of a crescent."""
    return min(max(cot_face / (cot_face + cot_plane), 0.0), 1.0)


@helper
def _steepening(a, b, c, crescents):  # type: ignore[no-untyped-def]
    """Return y of the plane of least weight with crescents over that without them.

    It is the root of the derivative of (a + y) (b + c y) / y (1 + crescents (a + y)), by Newton's
    method.

    Args:
        a, b, c: constants of the term of the weight, see `_failure_plane`.
        crescents: additional width over that of the blade, per a + y.
    """
    if c <= 0.0 or a * b <= 0.0:
        return 1.0
    without = math.sqrt(a * b / c)
    y = without
    for _ in range(_NUM_NEWTON_STEPS):
        width = 1.0 + crescents * (a + y)
        product = y * (a + y) * (b + c * y)
        value = c * y * y - a * b + crescents * product / width
        rise = 2.0 * c * y + crescents / width * (
            a * b + 2.0 * (b + a * c) * y + 3.0 * c * y * y - crescents * product / width
        )
        y = max(y - value / rise, 0.1 * y)
    return y / without
