"""Tool plates: thin convex polygons, and the closest point of one to a particle centre.

A plate has its own frame: origin at its first corner, u along its first edge, n its normal (the
corners turn counter-clockwise about n), v = n x u. The plate coordinates of a point are (a, b, h)
along u, v, n; those of a corner are (a, b, 0).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.dem.state import ParticleError
from msg_bridge.kernels import helper

__all__ = [
    "BOUNDS_CENTRE",
    "BOUNDS_NORMAL",
    "BOUNDS_OFFSET",
    "BOUNDS_RADIUS",
    "FRAME_N",
    "FRAME_ORIGIN",
    "FRAME_U",
    "FRAME_V",
    "MAX_CORNERS",
    "Plates",
    "closest_in_polygon",
    "plate_coordinates",
]

MAX_CORNERS = 8
"""Maximum number of corners of a plate."""

FRAME_ORIGIN, FRAME_U, FRAME_V, FRAME_N = 0, 3, 6, 9
"""First of three slots of the origin [m] and of each axis in a row of `Plates.frame`."""
_FRAME_SIZE = 12

BOUNDS_NORMAL, BOUNDS_OFFSET, BOUNDS_CENTRE, BOUNDS_RADIUS = 0, 3, 4, 7
"""Rows of `Plates.bounds`: the plane (normal in three rows, offset along it [m]), and the bounding
sphere of the corners (centre in three rows, radius [m])."""
_BOUNDS_SIZE = 8


class Plates(NamedTuple):
    """Plates of a tool in its frame, or of all tools, each in the frame of its tool.

    Attributes:
        frame: origin [m] and axes u, v, n of each plate, tool frame, shape (plates, 12); slots
            `FRAME_ORIGIN`, `FRAME_U`, `FRAME_V`, `FRAME_N`.
        corner: (a, b) of each corner [m], shape (plates, MAX_CORNERS, 2).
        num_corners: number of corners of each plate, shape (plates,), int64.
        bounds: plane and bounding sphere of each plate, tool frame, shape (8, plates); rows
            `BOUNDS_NORMAL`, `BOUNDS_OFFSET`, `BOUNDS_CENTRE`, `BOUNDS_RADIUS`.
    """

    frame: NDArray[np.float64]
    corner: NDArray[np.float64]
    num_corners: NDArray[np.int64]
    bounds: NDArray[np.float64]

    @classmethod
    def from_polygons(cls, polygons: Sequence[ArrayLike]) -> Plates:
        """Build from the corners of each polygon in order around it [m], tool frame, shape (k, 3).

        Raises:
            ParticleError: fewer than 3 or more than 8 corners, or a polygon that is not planar,
                convex and finite.
        """
        count = len(polygons)
        frame = np.zeros((count, _FRAME_SIZE))
        corner = np.zeros((count, MAX_CORNERS, 2))
        num_corners = np.zeros(count, dtype=np.int64)
        bounds = np.zeros((_BOUNDS_SIZE, count))
        for k, polygon in enumerate(polygons):
            points = np.asarray(polygon, dtype=np.float64)
            error = _polygon_error(points)
            if error:
                raise ParticleError(f"tool plate {k} {error}")
            u, v, n = _axes(points)
            frame[k] = np.concatenate([points[0], u, v, n])
            num_corners[k] = len(points)
            corner[k, : len(points)] = (points - points[0]) @ np.stack([u, v], axis=1)
            centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
            # The corners may be a little outside of the plane, and count as projected onto it.
            projected = points - np.outer((points - points[0]) @ n, n)
            radius = max(
                np.linalg.norm(each - centre, axis=1).max() for each in (points, projected)
            )
            bounds[:, k] = [*n, n @ points[0], *centre, radius]
        return cls(frame, corner, num_corners, bounds)

    @classmethod
    def concatenate(cls, tools: Sequence[Plates]) -> Plates:
        """Return the plates of all tools in one table, tool by tool."""
        frame, corner, num_corners, bounds = zip(cls.from_polygons([]), *tools, strict=True)
        return cls(
            np.concatenate(frame),
            np.concatenate(corner),
            np.concatenate(num_corners),
            np.concatenate(bounds, axis=1),
        )


def _axes(
    points: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the axes u, v, n of a polygon; n by Newell's sum over the edges."""
    n = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)
    n = n / np.linalg.norm(n)
    u = points[1] - points[0]
    u = u - (u @ n) * n
    u = u / np.linalg.norm(u)
    return u, np.cross(n, u), n


def _polygon_error(points: NDArray[np.float64]) -> str:
    """Return the predicate of the error message for a polygon, empty if it is valid."""
    if points.ndim != 2 or points.shape[1] != 3 or not 3 <= len(points) <= MAX_CORNERS:
        return f"has shape {points.shape}; give 3 to {MAX_CORNERS} corners of 3 coordinates"
    if not np.isfinite(points).all():
        return "has a corner that is not finite"
    edges = np.roll(points, -1, axis=0) - points
    size = float(np.ptp(points, axis=0).max())
    doubled_area = np.linalg.norm(np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0))
    if doubled_area < 1e-6 * size**2 or np.linalg.norm(edges, axis=1).min() < 1e-6 * size:
        return "has no area or a repeated corner"
    n = _axes(points)[2]
    if np.abs((points - points[0]) @ n).max() > 1e-4 * size:
        return "is not planar; split it into triangles"
    if (np.cross(edges, np.roll(edges, -1, axis=0)) @ n).min() < -1e-6 * size**2:
        return "is not convex; split it into convex polygons"
    return ""


@helper(forceinline=True)
def plate_coordinates(plates, k, x, y, z):  # type: ignore[no-untyped-def]
    """Return the plate coordinates (a, b, h) at plate k of a point [m] of the tool frame."""
    frame = plates.frame
    x -= frame[k, FRAME_ORIGIN]
    y -= frame[k, FRAME_ORIGIN + 1]
    z -= frame[k, FRAME_ORIGIN + 2]
    a = x * frame[k, FRAME_U] + y * frame[k, FRAME_U + 1] + z * frame[k, FRAME_U + 2]
    b = x * frame[k, FRAME_V] + y * frame[k, FRAME_V + 1] + z * frame[k, FRAME_V + 2]
    h = x * frame[k, FRAME_N] + y * frame[k, FRAME_N + 1] + z * frame[k, FRAME_N + 2]
    return a, b, h


@helper(forceinline=True)
def closest_in_polygon(plates, k, a, b):  # type: ignore[no-untyped-def]
    """Return the point of plate k closest to (a, b) in its plane, and whether (a, b) is inside.

    The closest point of a convex polygon lies on an edge that (a, b) is outside of.
    """
    corner, num_corners = plates.corner, plates.num_corners
    inside = True
    closest_a, closest_b = a, b
    min_distance2 = 1e300
    n = num_corners[k]
    for e in range(n):
        f = e + 1 if e + 1 < n else 0
        ea, eb = corner[k, f, 0] - corner[k, e, 0], corner[k, f, 1] - corner[k, e, 1]
        pa, pb = a - corner[k, e, 0], b - corner[k, e, 1]
        if ea * pb - eb * pa < 0.0:
            inside = False
            t = min(max((pa * ea + pb * eb) / (ea * ea + eb * eb), 0.0), 1.0)
            ca, cb = corner[k, e, 0] + t * ea, corner[k, e, 1] + t * eb
            distance2 = (a - ca) ** 2 + (b - cb) ** 2
            if distance2 < min_distance2:
                min_distance2 = distance2
                closest_a, closest_b = ca, cb
    return closest_a, closest_b, inside
