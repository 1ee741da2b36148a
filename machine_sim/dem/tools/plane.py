"""Packed planes and half-spaces: a unit normal and an offset [m]; n.x < offset is inside."""

from __future__ import annotations

from msg_bridge.kernels import helper

__all__ = ["PLANE_NORMAL", "PLANE_OFFSET", "PLANE_SIZE", "signed_distance"]

PLANE_NORMAL = 0
"""First of three slots of the unit normal in a packed plane."""
PLANE_OFFSET = 3
"""Slot of the offset along the normal [m]."""
PLANE_SIZE = 4
"""Numbers in a packed plane."""


@helper(forceinline=True)
def signed_distance(plane, x, y, z):  # type: ignore[no-untyped-def]
    """Return the distance of a point [m] from a packed plane, positive on the normal's side."""
    distance = plane[PLANE_NORMAL] * x + plane[PLANE_NORMAL + 1] * y
    return distance + (plane[PLANE_NORMAL + 2] * z - plane[PLANE_OFFSET])
