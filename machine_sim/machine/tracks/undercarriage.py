"""Forces of the undercarriage on the shoes of the dynamic tracks.

Between sprocket and idler the guides of a shoe are springs and dampers without friction, with the
opposite force on the base: the rail below, carriers that limit sag and buckling of the slack run
above, flanges that keep the chain in line, and a brake.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from msg_bridge.kernels import helper

__all__ = ["UndercarriageSupport", "support_force"]

_BEVEL_START, _BEVEL_SLOPE = 1.57, 0.2
"""Rail and carriers are bevelled by this slope from that many shoes before an axle on: the height
at which a chain leaves the flats of a sprocket varies."""

_CARRIER_CLEARANCE = 0.01
"""Vertical play of the upper run between the carriers [m]."""


class UndercarriageSupport(NamedTuple):
    """Springs and dampers between one shoe and the base.

    Attributes:
        stiffness, damping: flanges, carriers and brake [N/m], [N s/m].
        rail_stiffness, rail_damping: rail [N/m], [N s/m].
        max_brake_force: maximum force of the brake [N].
    """

    stiffness: float
    damping: float
    rail_stiffness: float
    rail_damping: float
    max_brake_force: float


@helper(forceinline=True)
def support_force(  # type: ignore[no-untyped-def]
    position, velocity, dimensions, supports, is_braked, brake_anchors, side, k
):
    """Return the force of the undercarriage on a shoe [N].

    Args:
        position, velocity: of the shoe relative to the base [m], [m/s]; base frame with y from the
            middle of its track.
        dimensions, supports: `TrackDimensions`, `UndercarriageSupport`.
        is_braked: whether the brake of this side is on.
        brake_anchors: `ShoeBodies.brake_anchors`; updated.
        side, k: indices of the side and of the shoe.
    """
    x, y, z = position
    vx, vy, vz = velocity
    fx, fy, fz = 0.0, 0.0, 0.0
    is_between_axles = abs(x) <= dimensions.half_axle_distance
    bevel = _BEVEL_SLOPE * max(
        abs(x) - dimensions.half_axle_distance + _BEVEL_START * dimensions.sprocket_radius, 0.0
    )
    if z < dimensions.axle_height:
        fy = -supports.stiffness * y - supports.damping * vy
        penetration = z - (dimensions.axle_height - dimensions.sprocket_radius + bevel)
        if is_between_axles and penetration > 0.0:
            fz = -max(supports.rail_stiffness * penetration + supports.rail_damping * vz, 0.0)
    elif is_between_axles:
        offset = z - dimensions.axle_height - dimensions.sprocket_radius
        penetration = max(offset - _CARRIER_CLEARANCE, 0.0) + min(
            offset + _CARRIER_CLEARANCE + bevel, 0.0
        )
        force = -supports.stiffness * penetration - supports.damping * vz
        if force * penetration < 0.0:
            fz = force
    if is_braked and is_between_axles and z < dimensions.axle_height:
        if math.isnan(brake_anchors[side, k]):
            brake_anchors[side, k] = x
        fx = -supports.stiffness * (x - brake_anchors[side, k]) - supports.damping * vx
        if abs(fx) > supports.max_brake_force:
            fx = math.copysign(supports.max_brake_force, fx)
            # The anchor follows, so that the spring alone gives the sliding force.
            brake_anchors[side, k] = x + fx / supports.stiffness
    else:
        brake_anchors[side, k] = math.nan
    return fx, fy, fz
