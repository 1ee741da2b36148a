"""An open container with parallel sides: the common base of buckets and beds.

It is a convex profile in the side view, extruded across the width. The straight line between the
ends of the profile is its opening.
"""

from __future__ import annotations

import math
from functools import cached_property
from itertools import pairwise
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine.box import Box
from machine_sim.machine.errors import MachineError
from msg_bridge.kernels import BoxedTable, box_table, helper

__all__ = [
    "ContainerTable",
    "HalfPlanes",
    "OpenContainer",
    "Opening",
    "is_in_heap",
    "is_in_struck_volume",
    "local_point",
]

Array = NDArray[np.float64]

_NUM_SIDE_SLABS = 6
"""Boxes that approximate one side wall."""

_BOUNDING_MARGIN = 0.01
"""Margin of the bounding sphere [m], above all rounding."""


class Opening(NamedTuple):
    """Opening of a container in the side view, and the heap on it.

    Attributes:
        lip_x, lip_z: first point of the profile [m].
        along_x, along_z: unit vector from the lip to the other rim.
        out_x, out_z: unit normal out of the container.
        length: distance between the rims [m].
        heap_height: height of a heap with slopes of 45 degrees [m].
    """

    lip_x: float
    lip_z: float
    along_x: float
    along_z: float
    out_x: float
    out_z: float
    length: float
    heap_height: float


class HalfPlanes(NamedTuple):
    """Half-planes n.p <= d in the side view, whose intersection is the struck volume.

    Attributes:
        normals: outward unit normals of the strips and, last, the opening, shape (n, 2).
        offsets: d of each half-plane [m], shape (n,).
    """

    normals: Array
    offsets: Array


class ContainerTable(NamedTuple):
    """Shape of a container, for kernels.

    Attributes:
        profile, width, opening, half_planes, bounding_radius: see `OpenContainer`.
    """

    profile: Array
    width: float
    opening: Opening
    half_planes: HalfPlanes
    bounding_radius: float


class OpenContainer:
    """A profile, extruded across a width.

    Attributes:
        profile: corners (x, z) [m] from one rim along the floor to the other, counter-clockwise
            with x to the right and z up, shape (n, 2).
        width: inside width [m].
        plate_thickness: thickness of the plates as drawn [m]; the physics treats them as thin.
    """

    spins: ClassVar[bool] = False
    can_carry_soil: ClassVar[bool] = True

    profile: Array
    width: float
    plate_thickness: float

    def _validate(self, name: str, min_points: int) -> None:
        """Check all values, and replace the profile by a read-only copy.

        Args:
            name: name of the shape in messages.
            min_points: minimum number of corners.

        Raises:
            MachineError: a value is out of range, or the profile is not convex or clockwise.
        """
        profile = np.array(self.profile, dtype=np.float64)
        if profile.ndim != 2 or profile.shape[1] != 2 or len(profile) < min_points:
            raise MachineError(
                f"{name}.profile has shape {profile.shape}; give {min_points} or more points [x, z]"
            )
        if not np.isfinite(profile).all():
            raise MachineError(f"{name}.profile is not finite; give points [x, z] in metres")
        for attribute in ("width", "plate_thickness"):
            value = getattr(self, attribute)
            if not (np.isfinite(value) and value > 0.0):
                raise MachineError(
                    f"{name}.{attribute} is {value}; give a number of metres above 0"
                )
        edge = np.roll(profile, -1, axis=0) - profile
        turn = edge[:, 0] * np.roll(edge[:, 1], -1) - edge[:, 1] * np.roll(edge[:, 0], -1)
        # A star also turns in one direction at every corner, but by more than one full turn.
        heading = np.unwrap(np.arctan2(edge[:, 1], edge[:, 0]))
        if not (turn > 1e-12).all() or heading[-1] - heading[0] > 2.0 * np.pi:
            worst = int(np.argmin(turn) + 1) % len(profile)
            raise MachineError(
                f"{name}.profile is not convex and counter-clockwise at point {worst}; give the"
                " points from rim to rim with x to the right and z up"
            )
        profile.setflags(write=False)
        object.__setattr__(self, "profile", profile)

    @cached_property
    def opening_length(self) -> float:
        """Distance between the rims [m]; of a bucket, from cutting lip to upper rim."""
        return float(np.hypot(*(self.profile[-1] - self.profile[0])))

    @cached_property
    def opening_normal(self) -> Array:
        """Unit normal of the opening, out of the container, shape (3,)."""
        dx, dz = (self.profile[-1] - self.profile[0]) / self.opening_length
        return np.array([-dz, 0.0, dx])

    @cached_property
    def struck_capacity(self) -> float:
        """Volume below the opening [m^3]."""
        x, z = self.profile.T
        area = 0.5 * float(np.sum(x * np.roll(z, -1) - np.roll(x, -1) * z))
        return area * self.width

    @cached_property
    def heaped_capacity(self) -> float:
        """Struck volume and a 1:1 heap on the opening [m^3], as ISO 7451 rates excavator buckets.

        On a rectangle a x b (a <= b) the heap with slopes of 45 degrees is a hip roof of height
        a/2 and volume a^2 (3b - a) / 12.
        """
        a, b = sorted((self.opening_length, self.width))
        return self.struck_capacity + a * a * (3.0 * b - a) / 12.0

    def plates(self) -> list[Array]:
        """Return the inside faces of the shell as convex planar polygons [m].

        Returns:
            The strips of the floor from the first rim on, shape (4, 3) each, then the left and the
            right side, shape (n, 3). Corners are counter-clockwise seen from outside.
        """
        left, right = self._edge(+1), self._edge(-1)
        strips = [
            np.array([left[k], left[k + 1], right[k + 1], right[k]])
            for k in range(len(self.profile) - 1)
        ]
        return [*strips, left[::-1].copy(), right]

    def boxes(self) -> list[Box]:
        """Return a box for each strip of the floor, and slabs for each side wall."""
        plate_thickness, width, profile = self.plate_thickness, self.width, self.profile
        boxes = []
        for a, b in pairwise(profile):
            middle, edge = 0.5 * (a + b), b - a
            boxes.append(
                Box(
                    (float(np.hypot(*edge)), width, plate_thickness),
                    (float(middle[0]), 0.0, float(middle[1])),
                    math.atan2(-edge[1], edge[0]),
                )
            )
        # Each side wall is a row of slabs that reach from the opening to the shell.
        along = (profile[-1] - profile[0]) / self.opening_length
        inward = -self.opening_normal[[0, 2]]
        local = profile - profile[0]
        u, depth = local @ along, local @ inward
        step = self.opening_length / _NUM_SIDE_SLABS
        for k in range(_NUM_SIDE_SLABS):
            at = (k + 0.5) * step
            high = float(np.interp(at, u, depth))
            x, z = profile[0] + at * along + 0.5 * high * inward
            boxes += [
                Box(
                    (step, plate_thickness, high),
                    (float(x), side * 0.5 * (width + plate_thickness), float(z)),
                    math.atan2(-along[1], along[0]),
                )
                for side in (+1, -1)
            ]
        return boxes

    def contains(self, points_local: ArrayLike) -> NDArray[np.bool_]:
        """Return which points [m], shape (n, 3), lie in the struck volume, shape (n,)."""
        points = np.asarray(points_local, dtype=np.float64).reshape(-1, 3)
        normals, offsets = self.half_planes
        inside = (points[:, [0, 2]] @ normals.T <= offsets + 1e-12).all(axis=1)
        return np.asarray(inside & (np.abs(points[:, 1]) <= 0.5 * self.width), dtype=np.bool_)

    @cached_property
    def boxed(self) -> BoxedTable:
        """`ContainerTable`, boxed, for kernels."""
        return box_table(
            ContainerTable(
                self.profile,
                float(self.width),
                self.opening,
                self.half_planes,
                self.bounding_radius,
            )
        )

    @cached_property
    def bounding_radius(self) -> float:
        """Radius of a sphere about the frame's origin around the container and its heap [m]."""
        heap_height = self.opening.heap_height
        corners = np.vstack(
            [self.profile, self.profile + heap_height * self.opening_normal[[0, 2]]]
        )
        reach = float(np.hypot(*corners.T).max())
        return math.hypot(reach, 0.5 * self.width) + _BOUNDING_MARGIN

    @cached_property
    def opening(self) -> Opening:
        """The opening, and the heap on it: a prism as high as the ridge of a 1:1 heap, half the
        shorter side of the opening.
        """
        length = self.opening_length
        (lip_x, lip_z), (rim_x, rim_z) = self.profile[[0, -1]].tolist()
        out_x, _, out_z = self.opening_normal.tolist()
        return Opening(
            lip_x=lip_x,
            lip_z=lip_z,
            along_x=(rim_x - lip_x) / length,
            along_z=(rim_z - lip_z) / length,
            out_x=out_x,
            out_z=out_z,
            length=length,
            heap_height=0.5 * min(length, float(self.width)),
        )

    @cached_property
    def half_planes(self) -> HalfPlanes:
        """Half-planes of the struck volume."""
        edge = np.roll(self.profile, -1, axis=0) - self.profile
        normals = np.column_stack([edge[:, 1], -edge[:, 0]])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return HalfPlanes(normals, np.einsum("ij,ij->i", normals, self.profile))

    def _edge(self, side: int) -> Array:
        """Return the profile on the left (+1) or right (-1) side, shape (n, 3)."""
        y = np.full(len(self.profile), 0.5 * side * self.width)
        return np.column_stack([self.profile[:, 0], y, self.profile[:, 1]])


@helper(forceinline=True)
def local_point(position, i, container, rotation, origin):  # type: ignore[no-untyped-def]
    """Return whether a point can be in a container or its heap, and where it is in its frame [m].

    Args:
        position: points [m], map frame, shape (n, 3).
        i: row of the point.
        container: `ContainerTable`.
        rotation, origin: pose of the container, shapes (3, 3) and (3,).

    Returns:
        (whether it is between the sides and within the bounding sphere; x and z in the side view).
    """
    a, b = position[i, 0] - origin[0], position[i, 1] - origin[1]
    c = position[i, 2] - origin[2]
    if a * a + b * b + c * c > container.bounding_radius * container.bounding_radius:
        return False, 0.0, 0.0
    x = a * rotation[0, 0] + b * rotation[1, 0] + c * rotation[2, 0]
    y = a * rotation[0, 1] + b * rotation[1, 1] + c * rotation[2, 1]
    z = a * rotation[0, 2] + b * rotation[1, 2] + c * rotation[2, 2]
    return abs(y) <= 0.5 * container.width, x, z


@helper(forceinline=True)
def is_in_heap(x, z, container):  # type: ignore[no-untyped-def]
    """Return whether a point between the sides is in the heap on the opening.

    Args:
        x, z: the point in the side view [m].
        container: `ContainerTable`.
    """
    opening = container.opening
    dx, dz = x - opening.lip_x, z - opening.lip_z
    along = dx * opening.along_x + dz * opening.along_z
    above = dx * opening.out_x + dz * opening.out_z
    return 0.0 <= along <= opening.length and 0.0 <= above <= opening.heap_height


@helper(forceinline=True)
def is_in_struck_volume(x, z, container):  # type: ignore[no-untyped-def]
    """Return whether a point between the sides is in the struck volume.

    Args:
        x, z: the point in the side view [m].
        container: `ContainerTable`.
    """
    normals, offsets = container.half_planes.normals, container.half_planes.offsets
    for k in range(len(offsets)):
        if not normals[k, 0] * x + normals[k, 1] * z <= offsets[k] + 1e-12:
            return False
    return True
