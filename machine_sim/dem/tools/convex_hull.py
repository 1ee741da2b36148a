"""Convex hull of the corners of a tool, as half-spaces.

Incremental algorithm: the hull starts as a tetrahedron. Each further corner replaces the triangles
that it is outside of by a cone from the corner to their outline. The farthest corner is taken
next, so that triangles are large.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.tools.plane import PLANE_NORMAL, PLANE_OFFSET, PLANE_SIZE

__all__ = ["convex_hull_planes"]

_PLANE_TOLERANCE = 1e-6
"""Distance from a plane, in sizes of the tool, below which a corner counts as in the plane."""
_MIN_TRIANGLE_QUALITY = 1e-9
"""Doubled area of a triangle over its longest side squared, below which it has no plane."""
_NORMAL = slice(PLANE_NORMAL, PLANE_NORMAL + 3)


def convex_hull_planes(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the half-spaces of the convex hull of a tool's corners.

    Args:
        points: corners [m], shape (k, 3).

    Returns:
        Packed planes with outward normals, shape (planes, PLANE_SIZE): a point x is inside where
        n.x < offset for all of them. No planes for coplanar points, which enclose nothing.
    """
    points = np.unique(np.round(points, 9), axis=0)
    size = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    tolerance = _PLANE_TOLERANCE * size
    first = _tetrahedron(points, tolerance)
    if first is None:
        return np.zeros((0, PLANE_SIZE))
    interior = points[first].mean(axis=0)
    faces = np.array([first[:3], first[[0, 1, 3]], first[[0, 2, 3]], first[1:]])
    planes = _face_planes(points, faces, interior)
    remaining = np.delete(np.arange(len(points)), first)
    while remaining.size:
        heights = planes[:, _NORMAL] @ points[remaining].T - planes[:, PLANE_OFFSET:]
        max_height = heights.max(axis=0)
        farthest = int(max_height.argmax())
        if max_height[farthest] <= tolerance:
            break
        visible = heights[:, farthest] > tolerance
        cone = np.insert(_boundary_edges(faces[visible]), 2, remaining[farthest], axis=1)
        faces = np.concatenate([faces[~visible], cone])
        planes = np.concatenate([planes[~visible], _face_planes(points, cone, interior)])
        # A corner inside the hull stays inside while the hull grows.
        remaining = remaining[max_height > tolerance]
        remaining = remaining[remaining != cone[0, 2]]
    return _unique_planes(planes, size)


def _tetrahedron(points: NDArray[np.float64], tolerance: float) -> NDArray[np.intp] | None:
    """Return the indices of four corners, each as far as possible from those before it.

    None if all corners lie within `tolerance` [m] of one plane.
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
    points: NDArray[np.float64], faces: NDArray[np.intp], interior: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the planes of triangles with normals away from an interior point.

    Shape (faces, PLANE_SIZE); zero for a triangle that is too thin to have a plane.
    """
    a, b, c = (points[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)[:, None]
    longest = np.max([((p - q) ** 2).sum(axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    is_proper = lengths > _MIN_TRIANGLE_QUALITY * longest[:, None]
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=is_proper)
    offsets = np.einsum("ij,ij->i", normals, a)
    outward = np.where(normals @ interior > offsets, -1.0, 1.0)
    return np.column_stack([normals, offsets]) * outward[:, None]


def _boundary_edges(faces: NDArray[np.intp]) -> NDArray[np.intp]:
    """Return the edges that belong to only one triangle of a patch, shape (edges, 2)."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, counts = np.unique(edges, axis=0, return_counts=True)
    return np.asarray(unique[counts == 1], dtype=np.intp)


def _unique_planes(planes: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    """Return each plane once, in a fixed order: a face of many corners is many triangles."""
    planes = np.unique(np.round(planes[planes[:, _NORMAL].any(axis=1)], 9), axis=0)
    tolerance = _PLANE_TOLERANCE * np.array([1.0, 1.0, 1.0, size])
    kept: list[NDArray[np.float64]] = []
    for plane in planes:
        differs = np.abs(np.array(kept).reshape(-1, PLANE_SIZE) - plane) > tolerance
        if differs.any(axis=1).all():
            kept.append(plane)
    return np.array(kept).reshape(-1, PLANE_SIZE)
