"""Distance of a chain of the dynamic tracks from its wheels, by which one that came off is found.

The lower run may hang off the rail: it does so over a hollow when the machine climbs backward,
because the sprocket then pulls the upper run. A chain has come off when shoes of its other parts
have left their path, when any has moved aside, or when a wheel has no shoe.
"""

from __future__ import annotations

import math

from machine_sim.machine.tracks.rigid_body import row_vector, to_base
from machine_sim.machine.tracks.shoe_chain import SHOE_POSITION
from msg_bridge.kernels import helper

__all__ = ["chain_deviation", "local_position"]


@helper
def chain_deviation(states, base, dimensions, y_track):  # type: ignore[no-untyped-def]
    """Return the distance of a chain from its path [m].

    It is the maximum of the shoes' distances from the path, and of the distances of the path's
    front and rear end from the nearest shoe. The latter are up to half a sprocket radius on a
    chain that lies on its wheels.

    Args:
        states: states of the shoes of one side as in `ShoeBodies`, shape (N, 13).
        base: `BaseFrame`.
        dimensions: `TrackDimensions`.
        y_track: lateral position of the middle of the track [m], base frame.
    """
    deviation, from_sprocket, from_idler = 0.0, math.inf, math.inf
    end_x = dimensions.half_axle_distance + dimensions.sprocket_radius
    cx, cy, cz = base.center_of_mass
    for i in range(states.shape[0]):
        px, py, pz = row_vector(states, i, SHOE_POSITION)
        arm = (px - cx, py - cy, pz - cz)
        x, y, z = local_position(arm, base, dimensions.base_com, y_track)
        above_axles = z - dimensions.axle_height
        deviation = max(deviation, _path_deviation(x, y, above_axles, dimensions))
        across = y * y + above_axles * above_axles
        from_sprocket = min(from_sprocket, math.sqrt((x + end_x) ** 2 + across))
        from_idler = min(from_idler, math.sqrt((x - end_x) ** 2 + across))
    return max(deviation, from_sprocket, from_idler)


@helper(forceinline=True)
def local_position(arm, base, base_com, y_track):  # type: ignore[no-untyped-def]
    """Return the position of a shoe [m], base frame with y from the middle of its track.

    Args:
        arm: position from the base's centre of mass [m], map frame.
        base: `BaseFrame`.
        base_com: centre of mass of the base [m], base frame.
        y_track: as for `chain_deviation`.
    """
    x, y, z = to_base(base.rotation, arm)
    return x + base_com[0], y + base_com[1] - y_track, z + base_com[2]


@helper(forceinline=True)
def _path_deviation(x, y, above_axles, dimensions):  # type: ignore[no-untyped-def]
    """Return the distance of a shoe from its path [m]; on the lower run only to the side."""
    past_axle = max(abs(x) - dimensions.half_axle_distance, 0.0)
    if past_axle == 0.0 and above_axles < 0.0:
        return abs(y)
    radial = math.sqrt(past_axle**2 + above_axles**2) - dimensions.sprocket_radius
    return math.sqrt(radial**2 + y**2)
