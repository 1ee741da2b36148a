"""Factor of the force below an uneven surface: a berm, a bank or a trench within the failure wedge.

`surface_ahead` gives a straight line over the wedge with the weight of the soil there, and
`failure_wedge` the force of the plane of least resistance below that line. Below another surface
another plane has the least resistance: before a berm that a tool pushes, a flatter one, which
reaches the surface beyond the berm. So planes from the edge through the samples of the surface, and
through the line at the same distances, are tried:

    P(beta) = ((W + W_c) sin(beta + phi) + c L cos(phi)) / sin(rho + delta + beta + phi)

with the weight W of the soil between face and plane, that of the crescents beside the ends W_c, and
the length L of the plane. The factor is the ratio of the least P of both; 1 below a plane surface.
"""

from __future__ import annotations

import math

from msg_bridge.kernels import helper
from soil_sim.tool_force.failure_wedge import clamp_angles
from soil_sim.tool_force.surface_ahead import NUM_SAMPLES, area_to_face

__all__ = ["uneven_surface_factor"]

_MIN_SINE = 0.05
"""Minimum sine of rho + delta + beta + phi."""


@helper
def uneven_surface_factor(  # type: ignore[no-untyped-def]
    surface, samples, rake, phi, delta, cohesion_height, ends_per_width
):
    """Return the force below the samples of a surface over that below the line through them.

    Args:
        surface: `SurfaceAhead` of the strip.
        samples: heights of the surface above the edge [m], as written by `surface_ahead`.
        rake: angle of the face to the horizontal [rad].
        phi, delta: angles of friction of the soil and on the face [rad].
        cohesion_height: cohesion over unit weight [m].
        ends_per_width: number of ends of the blade beside which soil fails over its width [1/m].
    """
    if surface.spacing <= 0.0 or surface.line_depth <= 0.0:
        return 1.0
    face, phi, delta = clamp_angles(rake, phi, delta)
    cot, turned = math.cos(face) / math.sin(face), face + delta + phi
    tangent = math.tan(surface.slope)
    h_edge, line_edge = max(surface.at_edge, 0.0), surface.line_depth
    # Behind the edge, up to the face.
    area = area_to_face(h_edge, surface.near_tangent, face)
    line_area = area_to_face(line_edge, tangent, face)
    least = line_least = math.inf
    s, h, line = 0.0, h_edge, line_edge
    for k in range(NUM_SAMPLES):
        step = surface.start if k == 0 else surface.spacing
        h_next, line_next = samples[k], line + step * tangent
        area += 0.5 * step * (h + h_next)
        line_area += 0.5 * step * (line + line_next)
        s, h, line = s + step, h_next, line_next
        crescents = 0.0
        if line > 0.0:
            radius = line_edge * cot + s
            cos = min(max(line_edge * cot / radius, 0.0), 1.0)
            crescents = ends_per_width * radius * math.sqrt(1.0 - cos * cos) / 3.0
            crescents *= max(line_area - 0.5 * s * line, 0.0)
            push = _push(line_area, crescents, s, line, turned, phi, cohesion_height)
            line_least = min(line_least, push)
        if h > 0.0:
            least = min(least, _push(area, crescents, s, h, turned, phi, cohesion_height))
    if not 0.0 < least < math.inf or not 0.0 < line_least < math.inf:
        return 1.0
    return least / line_least


@helper(forceinline=True)
def _push(area, crescents, s, h, turned, phi, cohesion_height):  # type: ignore[no-untyped-def]
    """Return the push on a plane over the unit weight [m^2], infinite if it cannot fail.

    Args:
        area: of the soil between the face and the vertical at the end of the plane [m^2].
        crescents: area of the soil that fails beside the ends, spread over the width [m^2].
        s, h: distance and height of the end of the plane from the edge [m].
        turned: rho + delta + phi [rad].
        phi: angle of friction [rad].
        cohesion_height: cohesion over unit weight [m].
    """
    plane = math.atan2(h, s)
    sine = math.sin(turned + plane)
    if turned + plane >= math.pi or sine < _MIN_SINE:
        return math.inf
    weight = area - 0.5 * s * h + crescents
    strength = cohesion_height * math.hypot(s, h) * math.cos(phi)
    return (weight * math.sin(plane + phi) + strength) / sine
