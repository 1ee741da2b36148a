"""Tool plates: thin convex polygons, and the closest point of one to a particle centre.

A plate has its own frame: origin at its first corner, u along its first edge, n its normal (the
corners turn counter-clockwise about n), v = n x u. A point's plate coordinates are (a, b, h) along
u, v, n; a corner's are (a, b, 0).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.dem.state import ParticleError
from msg_bridge.kernels import kernel

__all__ = ["MAX_CORNERS", "Plates", "closest_in_polygon", "convex_hull_planes", "plate_coordinates"]

MAX_CORNERS = 8

_PLANE_TOLERANCE = 1e-6
"""Height, in sizes of a tool, below which a corner counts as in a plane."""
_MIN_TRIANGLE_QUALITY = 1e-9
"""Doubled area of a triangle over its longest side squared, below which it has no plane."""


class Plates(NamedTuple):
    """Plates of a tool, in its frame; or of all tools, each in its own.

    Attributes:
        frame: origin, u, v, n of each plate [m], shape (plates, 12).
        corner: (a, b) of each corner [m], shape (plates, MAX_CORNERS, 2).
        corners: number of corners of each plate, shape (plates,), int64.
        bounds: n, height of the plane along it, centre and radius of a ball around the corners [m],
            tool frame, shape (8, plates).
    """

    frame: NDArray[np.float64]
    corner: NDArray[np.float64]
    num_corners: NDArray[np.int64]
    bounds: NDArray[np.float64]

    @classmethod
    def from_polygons(cls, polygons: Sequence[ArrayLike]) -> Plates:
        """Build from corner points, each polygon of shape (k, 3) [m], tool frame, in order around.

        Raises:
            ParticleError: fewer than 3 or more than 8 corners, or not planar, convex and finite.
        """
        count = len(polygons)
        frame = np.zeros((count, 12))
        corner = np.zeros((count, MAX_CORNERS, 2))
        num_corners = np.zeros(count, dtype=np.int64)
        bounds = np.zeros((8, count))
        for k, polygon in enumerate(polygons):
            points = np.asarray(polygon, dtype=np.float64)
            fault = _polygon_error(points)
            if fault:
                raise ParticleError(f"tool plate {k} {fault}")
            u, v, n = _axes(points)
            frame[k] = np.concatenate([points[0], u, v, n])
            num_corners[k] = len(points)
            corner[k, : len(points)] = (points - points[0]) @ np.stack([u, v], axis=1)
            centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
            radius = np.linalg.norm(points - centre, axis=1).max()
            bounds[:, k] = [*n, n @ points[0], *centre, radius]
        return cls(frame, corner, num_corners, bounds)

    @classmethod
    def concatenate(cls, tools: Sequence[Plates]) -> Plates:
        """Those of some tools one after another; none without tools."""
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
    """u, v, n of a polygon; n by Newell's sum over its edges."""
    n = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)
    n = n / np.linalg.norm(n)
    u = points[1] - points[0]
    u = u - (u @ n) * n
    u = u / np.linalg.norm(u)
    return u, np.cross(n, u), n


def _polygon_error(points: NDArray[np.float64]) -> str:
    """What is wrong with a polygon, empty if nothing."""
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
        return "is not convex; split it"
    return ""


def convex_hull_planes(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Half-spaces of the convex hull of a tool's corners.

    The hull grows from a tetrahedron, corner by corner: triangles that see the new corner give way
    to a cone from it to their outline. The farthest corner is next, so that triangles are large.

    Args:
        points: shape (k, 3) [m].

    Returns:
        Outward unit normals and offsets, shape (planes, 4): inside where n.x < offset for all.
        Of shape (0, 4) for points of one plane, which enclose nothing.
    """
    points = np.unique(np.round(points, 9), axis=0)
    size = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    tolerance = _PLANE_TOLERANCE * size
    first = _tetrahedron(points, tolerance)
    if first is None:
        return np.zeros((0, 4))
    inner = points[first].mean(axis=0)
    faces = np.array([first[:3], first[[0, 1, 3]], first[[0, 2, 3]], first[1:]])
    planes = _face_planes(points, faces, inner)
    left = np.delete(np.arange(len(points)), first)
    while left.size:
        heights = planes[:, :3] @ points[left].T - planes[:, 3:]
        highest = heights.max(axis=0)
        far = int(highest.argmax())
        if highest[far] <= tolerance:
            break
        seen = heights[:, far] > tolerance
        cone = np.insert(_boundary_edges(faces[seen]), 2, left[far], axis=1)
        faces = np.concatenate([faces[~seen], cone])
        planes = np.concatenate([planes[~seen], _face_planes(points, cone, inner)])
        # Those inside the hull stay there, whatever is added to it.
        left = left[highest > tolerance]
        left = left[left != cone[0, 2]]
    return _unique_planes(planes, size)


def _tetrahedron(points: NDArray[np.float64], tolerance: float) -> NDArray[np.intp] | None:
    """Four corners that span much of the room, each as far as can be from those before it.

    None if all lie within `tolerance` [m] of one plane.
    """
    if len(points) < 4:
        return None
    a = int(points[:, 0].argmin())
    b = int(np.linalg.norm(points - points[a], axis=1).argmax())
    along = points[b] - points[a]
    across = np.cross(along, points - points[a])
    c = int(np.linalg.norm(across, axis=1).argmax())
    length = float(np.linalg.norm(across[c]))
    if length <= tolerance * float(np.linalg.norm(along)):
        return None
    heights = np.abs((points - points[a]) @ across[c]) / length
    d = int(heights.argmax())
    return None if heights[d] <= tolerance else np.array([a, b, c, d], dtype=np.intp)


def _face_planes(
    points: NDArray[np.float64], faces: NDArray[np.intp], inner: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Planes of triangles, shape (faces, 4), normals away from a point inside; slivers' are 0."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)[:, None]
    longest = np.max([((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    proper = lengths > _MIN_TRIANGLE_QUALITY * longest[:, None]
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=proper)
    offsets = np.einsum("ij,ij->i", normals, a)
    outward = np.where(normals @ inner > offsets, -1.0, 1.0)
    return np.column_stack([normals, offsets]) * outward[:, None]


def _boundary_edges(faces: NDArray[np.intp]) -> NDArray[np.intp]:
    """Edges that bound a patch of triangles, each of one of them only, shape (edges, 2)."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    known, times = np.unique(edges, axis=0, return_counts=True)
    return np.asarray(known[times == 1], dtype=np.intp)


def _unique_planes(planes: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    """One of each plane, in a fixed order: a face of many corners is many triangles."""
    planes = np.unique(np.round(planes[planes[:, :3].any(axis=1)], 9), axis=0)
    kept: list[NDArray[np.float64]] = []
    for plane in planes:
        apart = np.abs(np.array(kept).reshape(-1, 4) - plane) > [
            _PLANE_TOLERANCE,
            _PLANE_TOLERANCE,
            _PLANE_TOLERANCE,
            _PLANE_TOLERANCE * size,
        ]
        if apart.any(axis=1).all():
            kept.append(plane)
    return np.array(kept).reshape(-1, 4)


@kernel(forceinline=True)
def plate_coordinates(plates, k, x, y, z):  # type: ignore[no-untyped-def]
    """(a, b, h) of a point (x, y, z) [m] of the tool frame at plate k."""
    frame = plates.frame
    x -= frame[k, 0]
    y -= frame[k, 1]
    z -= frame[k, 2]
    a = x * frame[k, 3] + y * frame[k, 4] + z * frame[k, 5]
    b = x * frame[k, 6] + y * frame[k, 7] + z * frame[k, 8]
    h = x * frame[k, 9] + y * frame[k, 10] + z * frame[k, 11]
    return a, b, h


@kernel(forceinline=True)
def closest_in_polygon(plates, k, a, b):  # type: ignore[no-untyped-def]
    """Point of plate k closest to (a, b) in its plane, and whether that is (a, b) itself.

    The closest point of a convex polygon lies on an edge that (a, b) is outside of.
    """
    corner, num_corners = plates.corner, plates.num_corners
    inside = True
    closest_a, closest_b = a, b
    best = 1e300
    n = num_corners[k]
    for e in range(n):
        f = e + 1 if e + 1 < n else 0
        ea, eb = corner[k, f, 0] - corner[k, e, 0], corner[k, f, 1] - corner[k, e, 1]
        pa, pb = a - corner[k, e, 0], b - corner[k, e, 1]
        if ea * pb - eb * pa < 0.0:
            inside = False
            t = min(max((pa * ea + pb * eb) / (ea * ea + eb * eb), 0.0), 1.0)
            ca, cb = corner[k, e, 0] + t * ea, corner[k, e, 1] + t * eb
            d2 = (a - ca) ** 2 + (b - cb) ** 2
            if d2 < best:
                best = d2
                closest_a, closest_b = ca, cb
    return closest_a, closest_b, inside
