"""Meshes of the elementary bodies: boxes, extrusions, bodies of revolution and tubes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine.rotations import cross
from machine_sim.machine.shapes.outline import (
    arc_segments,
    inset,
    rounded_outline,
    triangulate,
)
from machine_sim.machine.shapes.triangle_mesh import TriangleMesh

__all__ = ["Axis", "box", "cylinder", "extrusion", "revolution", "tube"]

Array = NDArray[np.float64]
Axis = Literal["x", "y", "z"]
Corners = Sequence[Sequence[float]]

_ROUND_CREASE_ANGLE = math.radians(75.0)
"""Crease angle of tubes, so that five or more flats look round [rad]."""

_AXES: dict[Axis, tuple[int, int, int]] = {"x": (1, 2, 0), "y": (0, 2, 1), "z": (0, 1, 2)}
"""Link axes of an outline's u and v and of the axis that it is extruded or rotated along."""


def box(size: ArrayLike, radius: float = 0.0) -> TriangleMesh:
    """Return a box about the origin with edges cut off at a distance of `radius` [m].

    Smooth shading makes the cut edges look round.

    Args:
        size: edge lengths [m], shape (3,).
        radius: at most half of the shortest edge [m]; 0 for sharp edges.
    """
    half = 0.5 * np.asarray(size, dtype=np.float64)
    cut = min(radius, 0.499 * float(half.min()) * 2.0)
    signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    if cut <= 0.0:
        points = signs * half
        axes = [np.eye(3)[k] for k in range(3)]
        polygons = [
            [i for i in range(8) if signs[i] @ axis == side] for axis in axes for side in (-1, 1)
        ]
        return _convex(points, polygons)
    points = np.concatenate([signs * (half - cut * (1.0 - np.eye(3)[k])) for k in range(3)])
    normal = np.repeat(np.arange(3), 8)  # axis of the face that each point lies on
    sign = np.tile(signs, (3, 1))
    polygons = []
    for axis in range(3):
        for side in (-1.0, 1.0):
            polygons.append(np.flatnonzero((normal == axis) & (sign[:, axis] == side)).tolist())
    for axis in range(3):
        a, b = (axis + 1) % 3, (axis + 2) % 3
        for side_a in (-1.0, 1.0):
            for side_b in (-1.0, 1.0):
                edge = (normal != axis) & (sign[:, a] == side_a) & (sign[:, b] == side_b)
                polygons.append(np.flatnonzero(edge).tolist())
    polygons += [[i, i + 8, i + 16] for i in range(8)]
    return _convex(points, polygons)


def extrusion(
    corners: Corners,
    width: float,
    *,
    axis: Axis = "y",
    position: float = 0.0,
    bevel: float = 0.0,
    holes: Sequence[Corners] = (),
) -> TriangleMesh:
    """Return an outline extruded along an axis, with bevelled edges at both ends.

    Args:
        corners: corners of the outline in the other two axes, in the order x, y, z; see
            `rounded_outline`.
        width: length along the axis [m].
        axis: axis of the extrusion.
        position: position of the middle along the axis [m].
        bevel: width of the bevels [m]; smaller radii of rounded corners are enlarged to it.
        holes: corners of openings.

    Raises:
        MachineError: the outline is too narrow for the bevel.
    """
    outline = rounded_outline([_at_least(corner, bevel) for corner in corners])
    openings = [rounded_outline(hole) for hole in holes]
    half = 0.5 * width
    # Height and inset of each ring of the outline. Holes have no bevel.
    layers = [(-half, bevel), (half, bevel)]
    if bevel > 0.0:
        layers = [(-half, bevel), (bevel - half, 0.0), (half - bevel, 0.0), (half, bevel)]
    points: list[Array] = []
    triangles: list[NDArray[np.int64]] = []
    first, last = _wall(outline, layers, position, points, triangles)
    low, high = [first], [last]
    for opening in openings:
        ends = [(-half, 0.0), (half, 0.0)]
        first, last = _wall(opening, ends, position, points, triangles, is_hole=True)
        low.append(first)
        high.append(last)
    cap = triangulate(inset(outline, bevel) if bevel > 0.0 else outline, openings)
    triangles += [np.concatenate(low)[cap][:, ::-1], np.concatenate(high)[cap]]
    return _to_link(np.concatenate(points), np.concatenate(triangles), axis)


def _wall(
    ring: Array,
    layers: Sequence[tuple[float, float]],
    position: float,
    points: list[Array],
    triangles: list[NDArray[np.int64]],
    *,
    is_hole: bool = False,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Add the wall along an outline; return the indices of its first and its last ring.

    Args:
        ring: counter-clockwise outline [m], shape (n, 2).
        layers: position and inset of each ring [m].
        position: position of the middle [m].
        points, triangles: those of the body, to which the wall's are added.
        is_hole: whether the inside of the outline is outside of the body.
    """
    rings = []
    for along, margin in layers:
        start = sum(map(len, points))
        flat = inset(ring, margin) if margin > 0.0 else ring
        points.append(np.column_stack([flat, np.full(len(flat), along + position)]))
        rings.append(start + np.arange(len(flat), dtype=np.int64))
    for low, high in pairwise(rings):
        after_low, after_high = np.roll(low, -1), np.roll(high, -1)
        sides = np.concatenate(
            [
                np.column_stack([low, after_low, after_high]),
                np.column_stack([low, after_high, high]),
            ]
        )
        triangles.append(sides[:, ::-1] if is_hole else sides)
    return rings[0], rings[-1]


def _at_least(corner: Sequence[float], bevel: float) -> Sequence[float]:
    """Return a corner whose radius, if it has one, is a little larger than the bevel."""
    if len(corner) < 3 or corner[2] <= 0.0:
        return corner
    return [corner[0], corner[1], max(corner[2], 1.05 * bevel)]


def cylinder(
    radius: float,
    length: float,
    *,
    axis: Axis = "y",
    bevel: float = 0.0,
    end_radius: float | None = None,
    bore: float = 0.0,
    sides: int = 16,
) -> TriangleMesh:
    """Return a cylinder or cone about the origin.

    Args:
        radius: radius at the end of negative coordinates [m].
        length: length along the axis [m].
        axis: its axis.
        bevel: width of the bevels at both ends [m].
        end_radius: radius at the other end [m]; as `radius` by default.
        bore: radius of a hole along the axis [m]; 0 for none.
        sides: number of flats.
    """
    half = 0.5 * length
    end = radius if end_radius is None else end_radius
    outer = [(radius, -half), (end, half)]
    if bevel > 0.0:
        outer = [(radius - bevel, -half), (radius, bevel - half), (end, half - bevel),
                 (end - bevel, half)]  # fmt: skip
    contour = [(bore, -half), *outer, (bore, half)]
    return revolution(contour, axis=axis, sides=sides)


def revolution(
    contour: Sequence[tuple[float, float]], *, axis: Axis = "y", sides: int = 16
) -> TriangleMesh:
    """Return a contour rotated about an axis.

    Args:
        contour: radius and position along the axis [m], outside in the direction of increasing
            position. It is closed from its last point to its first, unless both are on the axis.
        axis: axis of the rotation.
        sides: number of flats.
    """
    points: list[Array] = []
    rings: list[NDArray[np.int64]] = []
    angle = 2.0 * math.pi * np.arange(sides) / sides
    for radius, along in contour:
        first = sum(len(part) for part in points)
        if radius <= 1e-9:
            points.append(np.array([[0.0, 0.0, along]]))
            rings.append(np.full(sides, first, dtype=np.int64))
        else:
            ring = np.column_stack(
                [radius * np.cos(angle), radius * np.sin(angle), np.full(sides, along)]
            )
            points.append(ring)
            rings.append(first + np.arange(sides, dtype=np.int64))
    triangles = []
    is_open = contour[0][0] <= 1e-9 and contour[-1][0] <= 1e-9
    for low, high in zip(rings, rings[1:] if is_open else [*rings[1:], rings[0]], strict=False):
        after_low, after_high = np.roll(low, -1), np.roll(high, -1)
        triangles.append(np.column_stack([low, after_low, after_high]))
        triangles.append(np.column_stack([low, after_high, high]))
    found = np.concatenate(triangles)
    a, b, c = found.T
    found = found[(a != b) & (b != c) & (a != c)]
    return _to_link(np.concatenate(points), found, axis)


def tube(
    path: ArrayLike,
    radius: float,
    *,
    bend: float = 0.0,
    sides: int = 8,
    end_radius: float | None = None,
) -> TriangleMesh:
    """Return a round bar along a polyline.

    Args:
        path: points of its middle line [m], shape (n, 3).
        radius: radius of the bar [m].
        bend: radius of the middle line at inner points [m].
        sides: number of flats.
        end_radius: radius at the last point [m]; as `radius` by default.
    """
    middle = _bent(np.asarray(path, dtype=np.float64), bend)
    count = len(middle)
    steps = np.diff(middle, axis=0)
    steps /= np.linalg.norm(steps, axis=1, keepdims=True)
    tangents = np.vstack([steps[:1], steps[:-1] + steps[1:], steps[-1:]])
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    normal = cross(tangents[0], np.eye(3)[int(np.argmin(np.abs(tangents[0])))])
    angle = 2.0 * math.pi * np.arange(sides) / sides
    radii = np.linspace(radius, radius if end_radius is None else end_radius, count)
    rings = []
    for k in range(count):
        normal = normal - tangents[k] * (normal @ tangents[k])
        normal = normal / np.linalg.norm(normal)
        binormal = cross(tangents[k], normal)
        # Widen the ring at a sharp bend, so that the bar keeps its thickness.
        wide = 1.0 / max(float(tangents[k] @ steps[min(k, count - 2)]), 0.5)
        circle = np.outer(np.cos(angle), normal) + np.outer(np.sin(angle), binormal)
        rings.append(middle[k] + radii[k] * (wide if bend <= 0.0 else 1.0) * circle)
    index = np.arange(sides, dtype=np.int64)
    after = (index + 1) % sides
    triangles = []
    for k in range(count - 1):
        low, high = k * sides, (k + 1) * sides
        triangles.append(np.column_stack([low + index, low + after, high + after]))
        triangles.append(np.column_stack([low + index, high + after, high + index]))
    fan = np.column_stack([np.zeros(sides - 2, dtype=np.int64), index[1:-1], index[2:]])
    triangles += [fan[:, ::-1], fan + (count - 1) * sides]
    return TriangleMesh(np.concatenate(rings), np.concatenate(triangles), _ROUND_CREASE_ANGLE)


def _bent(path: Array, radius: float) -> Array:
    """Return a polyline (n, 3) with arcs at its inner points; an arc takes at most half an edge."""
    points = [path[0]]
    for before, here, after in zip(path, path[1:], path[2:], strict=False):
        incoming, outgoing = here - before, after - here
        lengths = float(np.linalg.norm(incoming)), float(np.linalg.norm(outgoing))
        incoming, outgoing = incoming / lengths[0], outgoing / lengths[1]
        turn = math.acos(min(max(float(incoming @ outgoing), -1.0), 1.0))
        if radius <= 0.0 or turn < 1e-3:
            points.append(here)
            continue
        tangent = min(radius * math.tan(0.5 * turn), 0.499 * min(lengths))
        bend = tangent / math.tan(0.5 * turn)
        inward = outgoing - incoming * float(outgoing @ incoming)
        inward /= np.linalg.norm(inward)
        start = here - tangent * incoming
        count = arc_segments(turn, bend)
        for k in range(count + 1):
            angle = turn * k / count
            points.append(
                start + bend * (math.sin(angle) * incoming + (1.0 - math.cos(angle)) * inward)
            )
    return np.array([*points, path[-1]])


def _convex(points: Array, polygons: Sequence[Sequence[int]]) -> TriangleMesh:
    """Return a convex body about the origin from the points of its faces, in any order."""
    triangles = []
    for polygon in polygons:
        corners = points[polygon]
        middle = corners.mean(axis=0)
        normal = cross(corners[1] - corners[0], corners[2] - corners[0])
        if normal @ middle < 0.0:
            normal = -normal
        first = corners[0] - middle
        second = cross(normal, first)
        angle = np.arctan2((corners - middle) @ second / np.linalg.norm(second),
                           (corners - middle) @ first / np.linalg.norm(first))  # fmt: skip
        order = np.asarray(polygon)[np.argsort(angle)]
        triangles += [(order[0], order[k], order[k + 1]) for k in range(1, len(order) - 1)]
    return TriangleMesh(points, np.array(triangles, dtype=np.int64))


def _to_link(local: Array, triangles: NDArray[np.int64], axis: Axis) -> TriangleMesh:
    """Return a mesh whose points are u, v and the position along `axis`."""
    points = np.empty_like(local)
    points[:, list(_AXES[axis])] = local
    # x, z, y is a left-handed order of the axes.
    return TriangleMesh(points, triangles[:, ::-1] if axis == "y" else triangles)
