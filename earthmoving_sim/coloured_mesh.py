"""Triangles with a normal and a colour at each point, for pictures."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["ColouredMesh", "merge_meshes", "polygon_mesh"]

Rgb = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class ColouredMesh:
    """Triangles in the map frame.

    Attributes:
        points: positions [m], shape (n, 3).
        normals: unit normals, shape (n, 3).
        colours: red, green and blue from 0 to 1, shape (n, 3).
        triangles: indices of the points of each triangle, shape (m, 3).
        parts: number of the body that each triangle belongs to, from 1; 0 for ground, shape (m,).
    """

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    colours: NDArray[np.float64]
    triangles: NDArray[np.intp]
    parts: NDArray[np.intp]


def merge_meshes(*meshes: ColouredMesh) -> ColouredMesh:
    """Return several meshes as one."""
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes[:-1])])
    return ColouredMesh(
        points=np.concatenate([mesh.points for mesh in meshes]),
        normals=np.concatenate([mesh.normals for mesh in meshes]),
        colours=np.concatenate([mesh.colours for mesh in meshes]),
        triangles=np.concatenate(
            [mesh.triangles + start for mesh, start in zip(meshes, starts, strict=True)]
        ),
        parts=np.concatenate([mesh.parts for mesh in meshes]),
    )


def polygon_mesh(
    polygons: Iterable[tuple[Rgb, NDArray[np.float64]]], first_part: int = 1
) -> ColouredMesh | None:
    """Return convex planar polygons as fans of triangles; None without a polygon.

    Args:
        polygons: colour and corners [m], shape (k, 3), of each.
        first_part: number of the first polygon as a body; each is a body of its own.
    """
    meshes = []
    for i, (colour, polygon) in enumerate(polygons):
        a, b, c = polygon[0], polygon[1], polygon[2]
        normal = np.cross(b - a, c - a)
        length = float(np.linalg.norm(normal))
        if length == 0.0:
            continue
        count = len(polygon)
        fan = np.stack([np.zeros(count - 2), np.arange(1, count - 1), np.arange(2, count)], axis=1)
        meshes.append(
            ColouredMesh(
                points=np.asarray(polygon, dtype=np.float64),
                normals=np.tile(normal / length, (count, 1)),
                colours=np.tile(colour, (count, 1)),
                triangles=fan.astype(np.intp),
                parts=np.full(count - 2, first_part + i, dtype=np.intp),
            )
        )
    return merge_meshes(*meshes) if meshes else None
