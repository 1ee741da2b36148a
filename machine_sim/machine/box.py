"""A box of a link's visual and collision shape."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Box", "Vec3"]

Vec3 = tuple[float, float, float]


@dataclass(frozen=True)
class Box:
    """A box in the frame of its link.

    Attributes:
        size: edge lengths [m].
        center: centre in the link frame [m].
        pitch: rotation about +y [rad].
    """

    size: Vec3
    center: Vec3
    pitch: float
