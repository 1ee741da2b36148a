"""Closed outlines in a plane: rounded corners, insets and triangulation."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.errors import MachineError

__all__ = ["arc_segments", "inset", "rounded_outline", "signed_area", "triangulate"]

Array = NDArray[np.float64]

_ARC_STEP = math.radians(30.0)
_SMALL_ARC_STEP = math.radians(46.0)
"""Maximum angle of one segment of an arc, and of one with a small radius [rad]."""
_SMALL_RADIUS = 0.105
"""Radius below which an arc is small [m]."""


def arc_segments(angle: float, radius: float) -> int:
    """Return the number of segments of an arc of `angle` [rad] and `radius` [m]."""
    step = _SMALL_ARC_STEP if radius < _SMALL_RADIUS else _ARC_STEP
    return max(2 if radius > _SMALL_RADIUS else 1, math.ceil(abs(angle) / step - 1e-9))


def rounded_outline(corners: Sequence[Sequence[float]]) -> Array:
    """Return a counter-clockwise outline, shape (n, 2), with its corners replaced by arcs.

    Args:
        corners: u, v [m] of each corner, and optionally the radius of its arc [m], in either
            sense. An arc takes at most half of both edges.
    """
    points = np.array([corner[:2] for corner in corners], dtype=np.float64)
    radii = [corner[2] if len(corner) > 2 else 0.0 for corner in corners]
    count = len(points)
    rounded: list[Array] = []
    for k, radius in enumerate(radii):
        before, here, after = points[k - 1], points[k], points[(k + 1) % count]
        rounded += _arc(before, here, after, radius)
    outline = np.array(rounded)
    return outline if signed_area(outline) > 0.0 else outline[::-1].copy()


def signed_area(outline: Array) -> float:
    """Return the area of an outline (n, 2) [m^2]; negative if it is clockwise."""
    u, v = outline.T
    return 0.5 * float(np.sum(u * np.roll(v, -1) - np.roll(u, -1) * v))


def inset(outline: Array, distance: float) -> Array:
    """Return a counter-clockwise outline (n, 2) moved inward by `distance` [m].

    Raises:
        MachineError: the outline is too narrow for the distance.
    """
    edges = np.roll(outline, -1, axis=0) - outline
    lengths = np.linalg.norm(edges, axis=1, keepdims=True)
    inward = np.column_stack([-edges[:, 1], edges[:, 0]]) / lengths
    both = inward + np.roll(inward, 1, axis=0)
    # The distance of the moved corner from both edges is `distance`.
    moved: Array = outline + distance * both * (2.0 / np.sum(both**2, axis=1, keepdims=True))
    if np.any(np.sum(edges * (np.roll(moved, -1, axis=0) - moved), axis=1) < 0.0):
        raise MachineError(
            f"bevel {abs(distance):g} m is wider than an edge or arc of the outline allows; give a"
            " smaller bevel, or corners with a larger radius"
        )
    return moved


def triangulate(outline: Array, holes: Sequence[Array]) -> NDArray[np.int64]:
    """Return triangles, shape (m, 3), counter-clockwise, of an outline with holes.

    Args:
        outline: counter-clockwise outline [m], shape (n, 2).
        holes: outlines of holes, shape (k, 2) each.

    Returns:
        Indices into the outline's points, followed by those of the holes.
    """
    import mapbox_earcut

    rings = [outline, *holes]
    points = np.concatenate(rings)
    ends = np.cumsum([len(ring) for ring in rings]).astype(np.uint32)
    found = mapbox_earcut.triangulate_float64(points, ends).reshape(-1, 3).astype(np.int64)
    a, b, c = (points[found[:, k]] for k in range(3))
    turn = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    found[turn < 0.0] = found[turn < 0.0][:, ::-1]
    return found


def _arc(before: Array, here: Array, after: Array, radius: float) -> list[Array]:
    """Return the points that replace the corner `here`."""
    incoming, outgoing = here - before, after - here
    lengths = float(np.linalg.norm(incoming)), float(np.linalg.norm(outgoing))
    incoming, outgoing = incoming / lengths[0], outgoing / lengths[1]
    cross = float(incoming[0] * outgoing[1] - incoming[1] * outgoing[0])
    turn = math.atan2(cross, float(incoming @ outgoing))
    if radius <= 0.0 or abs(turn) < 1e-3:
        return [here]
    tangent = min(radius * abs(math.tan(0.5 * turn)), 0.499 * min(lengths))
    radius = tangent / abs(math.tan(0.5 * turn))
    start = here - tangent * incoming
    normal = math.copysign(1.0, turn) * np.array([-incoming[1], incoming[0]])
    center = start + radius * normal
    angles = np.linspace(0.0, turn, arc_segments(turn, radius) + 1)
    u, v = start - center
    s, c = np.sin(angles), np.cos(angles)
    return list(center + np.column_stack([c * u - s * v, s * u + c * v]))
