"""Closed triangle meshes of single bodies, and their normals."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["ShadedMesh", "TriangleMesh", "merge_shaded", "shade"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_CREASE_ANGLE = math.radians(50.0)
"""Angle between two faces above which the edge between them is hard [rad]. A bevel at 45 degrees is
shaded smoothly into both faces; two bevels that meet at a square corner are 60 degrees apart."""


@dataclass(frozen=True, eq=False)
class TriangleMesh:
    """A closed body; triangles are counter-clockwise seen from outside.

    Attributes:
        points: positions [m], each once, shape (n, 3).
        triangles: indices of the points of each triangle, shape (m, 3).
        crease_angle: angle between two faces above which the edge between them is hard [rad].
    """

    points: Array
    triangles: Indices
    crease_angle: float = _CREASE_ANGLE

    def moved(self, rotation: Array, origin: ArrayLike) -> TriangleMesh:
        """Return the mesh rotated by a matrix (3, 3), then translated by `origin` [m]."""
        return replace(self, points=self.points @ rotation.T + np.asarray(origin))

    def shifted(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> TriangleMesh:
        """Return the mesh translated [m]."""
        return replace(self, points=self.points + np.array([x, y, z]))

    def mirrored(self) -> TriangleMesh:
        """Return the mesh reflected in the plane y = 0."""
        reflected = self.points * [1.0, -1.0, 1.0]
        return replace(self, points=reflected, triangles=self.triangles[:, ::-1])

    @property
    def volume(self) -> float:
        """Enclosed volume [m^3]; negative if the triangles face inward."""
        a, b, c = (self.points[self.triangles[:, k]] for k in range(3))
        return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0)


@dataclass(frozen=True, eq=False)
class ShadedMesh:
    """Triangles with a normal at each vertex; a point on a hard edge has several vertices.

    Attributes:
        points: positions [m], shape (n, 3).
        normals: outward unit normals, shape (n, 3).
        triangles: indices of the vertices of each triangle, shape (m, 3).
    """

    points: Array
    normals: Array
    triangles: Indices


def shade(mesh: TriangleMesh) -> ShadedMesh:
    """Return a mesh with normals: smooth where faces meet at less than `crease_angle`.

    The faces around a point that are connected by such angles share a vertex. Its normal is their
    mean, weighted by area, so that large flat faces stay flat beside a bevel.
    """
    corners = mesh.points[mesh.triangles]
    weighted = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(weighted, axis=1, keepdims=True)
    keep = length[:, 0] > 1e-12
    triangles, weighted, length = mesh.triangles[keep], weighted[keep], length[keep]
    unit = weighted / length
    points = triangles.ravel()
    first, second = _corner_pairs(points, len(mesh.points))
    is_smooth = np.einsum("ij,ij->i", unit[first // 3], unit[second // 3]) > math.cos(
        mesh.crease_angle
    )
    groups = _connected(len(points), first[is_smooth], second[is_smooth])
    chosen, vertex = np.unique(groups, return_inverse=True)
    normals = np.zeros((len(chosen), 3))
    np.add.at(normals, vertex, np.repeat(weighted, 3, axis=0))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return ShadedMesh(mesh.points[points[chosen]], normals, vertex.reshape(-1, 3).astype(np.int64))


def merge_shaded(meshes: Iterable[ShadedMesh]) -> ShadedMesh:
    """Return several meshes as one; an empty mesh for none."""
    parts = list(meshes)
    starts = np.cumsum([0, *(len(part.points) for part in parts)])
    empty = np.empty((0, 3))
    return ShadedMesh(
        np.concatenate([empty, *(part.points for part in parts)]),
        np.concatenate([empty, *(part.normals for part in parts)]),
        np.concatenate(
            [
                np.empty((0, 3), dtype=np.int64),
                *(part.triangles + start for part, start in zip(parts, starts, strict=False)),
            ]
        ),
    )


def _corner_pairs(points: Indices, num_points: int) -> tuple[Indices, Indices]:
    """Return all ordered pairs of corners, by number, that have the same point."""
    order = np.argsort(points, kind="stable").astype(np.int64)
    counts = np.bincount(points, minlength=num_points)
    starts = np.cumsum(counts) - counts
    of_corner = counts[points[order]]
    first = np.repeat(order, of_corner)
    within = np.arange(len(first)) - np.repeat(np.cumsum(of_corner) - of_corner, of_corner)
    second = order[np.repeat(starts[points[order]], of_corner) + within]
    return first, second


def _connected(count: int, first: Indices, second: Indices) -> Indices:
    """Return the smallest number in the group of each of `count` items that pairs connect."""
    groups = np.arange(count, dtype=np.int64)
    while True:
        joined = groups.copy()
        np.minimum.at(joined, first, groups[second])
        if np.array_equal(joined, groups):
            return groups
        groups = joined
