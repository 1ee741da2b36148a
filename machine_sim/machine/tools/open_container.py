"""A vessel with parallel sides: what a bucket and a truck's bed have in common.

A convex profile in the side view, drawn across the width; a straight *mouth* closes it, open.
"""

from __future__ import annotations

import math
from functools import cached_property
from itertools import pairwise
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine.box import Box
from machine_sim.machine.errors import MachineError
from msg_bridge.kernels import kernel

__all__ = ["OpenContainer"]

Array = NDArray[np.float64]

_NUM_SIDE_SLABS = 6
"""Boxes that approximate one side wall."""


class OpenContainer:
    """A profile, as it is drawn across a width.

    Attributes:
        profile: corners (x, z) [m] from one rim along the floor to the other, counter-clockwise
            with x to the right and z up, shape (n, 2).
        width: inside [m].
        plate: thickness of the plates as drawn [m]; the physics takes them as thin.
    """

    spins: ClassVar[bool] = False
    can_carry_soil: ClassVar[bool] = True

    profile: Array
    width: float
    plate_thickness: float

    def _validate(self, what: str, min_points: int) -> None:
        """Copy the profile, read-only.

        Args:
            what: its name in messages.
            least: corners at least.

        Raises:
            MachineError: numbers out of range, or a profile that is not convex or wound backwards.
        """
        profile = np.array(self.profile, dtype=np.float64)
        if profile.ndim != 2 or profile.shape[1] != 2 or len(profile) < min_points:
            raise MachineError(
                f"{what}.profile has shape {profile.shape}; give {min_points} or more points [x, z]"
            )
        if not np.isfinite(profile).all():
            raise MachineError(f"{what}.profile is not finite; give points [x, z] in metres")
        for name in ("width", "plate_thickness"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise MachineError(f"{what}.{name} is {value}; give a number of metres above 0")
        edge = np.roll(profile, -1, axis=0) - profile
        turn = edge[:, 0] * np.roll(edge[:, 1], -1) - edge[:, 1] * np.roll(edge[:, 0], -1)
        # All turns one way is not enough: a star turns one way too, but more than once round.
        heading = np.unwrap(np.arctan2(edge[:, 1], edge[:, 0]))
        if not (turn > 1e-12).all() or heading[-1] - heading[0] > 2.0 * np.pi:
            worst = int(np.argmin(turn) + 1) % len(profile)
            raise MachineError(
                f"{what}.profile is not convex, or runs the wrong way round (look at point"
                f" {worst}); give the points from rim to rim, turning one way"
            )
        profile.setflags(write=False)
        object.__setattr__(self, "profile", profile)

    @cached_property
    def opening_length(self) -> float:
        """From rim to rim [m]; of a bucket, cutting lip to upper rim."""
        return float(np.hypot(*(self.profile[-1] - self.profile[0])))

    @cached_property
    def opening_normal(self) -> Array:
        """Unit normal of the mouth plane, out of the vessel, shape (3,)."""
        dx, dz = (self.profile[-1] - self.profile[0]) / self.opening_length
        return np.array([-dz, 0.0, dx])

    @cached_property
    def struck_capacity(self) -> float:
        """Volume filled level with the mouth [m^3]."""
        x, z = self.profile.T
        area = 0.5 * float(np.sum(x * np.roll(z, -1) - np.roll(x, -1) * z))
        return area * self.width

    @cached_property
    def heaped_capacity(self) -> float:
        """Struck volume and a 1:1 heap on the mouth [m^3], as ISO 7451 rates excavator buckets.

        On a rectangle a x b (a <= b) the heap with slopes of 45 degrees is a hip roof of height
        a/2 and volume a^2 (3b - a) / 12.
        """
        a, b = sorted((self.opening_length, self.width))
        return self.struck_capacity + a * a * (3.0 * b - a) / 12.0

    def plates(self) -> list[Array]:
        """Inside faces of the shell as convex planar polygons [m].

        Returns:
            The strips of the floor, shape (4, 3) each, from the first rim on, then the left and
            the right side, shape (n, 3). Corners run counter-clockwise seen from outside.
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
        # A side wall in slabs that stand on the mouth and reach to the shell.
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
        """Which points [m], shape (n, 3), lie in the struck volume; shape (n,)."""
        points = np.asarray(points_local, dtype=np.float64).reshape(-1, 3)
        normals, offsets = self._half_planes
        inside = (points[:, [0, 2]] @ normals.T <= offsets + 1e-12).all(axis=1)
        return np.asarray(inside & (np.abs(points[:, 1]) <= 0.5 * self.width), dtype=np.bool_)

    def indices_in_heap(self, points: Array, rotation: Array, origin: Array) -> NDArray[np.intp]:
        """Rows of the points that it `contains` or has in the room of a heap, in order.

        That is the mouth prism, as high as the heap's ridge: half the mouth's shorter side above
        the mouth plane.

        Args:
            points: [m], map frame, shape (n, 3), float64.
            rotation, origin: pose of the vessel's frame, shapes (3, 3) and (3,).
        """
        half = 0.5 * self.width
        held: NDArray[np.intp] = _indices_in_heap(
            points, rotation, origin, *self._half_planes, self._opening, half
        )
        return held

    @cached_property
    def _opening(self) -> tuple[float, ...]:
        """Lip (x, z), way to the rim (x, z), out of the vessel (x, z), length, height of a heap."""
        (x, z), length = self.profile[0].tolist(), self.opening_length
        way = ((self.profile[-1] - self.profile[0]) / length).tolist()
        out = self.opening_normal[[0, 2]].tolist()
        return (x, z, *way, *out, length, 0.5 * min(length, self.width))

    @cached_property
    def _half_planes(self) -> tuple[Array, Array]:
        """Outward normals (n, 2) and offsets (n,) of strips and mouth (last): inside n.p <= d."""
        edge = np.roll(self.profile, -1, axis=0) - self.profile
        normals = np.column_stack([edge[:, 1], -edge[:, 0]])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return normals, np.einsum("ij,ij->i", normals, self.profile)

    def _edge(self, side: int) -> Array:
        """The profile on the left (+1) or right (-1) side, shape (n, 3)."""
        y = np.full(len(self.profile), 0.5 * side * self.width)
        return np.column_stack([self.profile[:, 0], y, self.profile[:, 1]])


@kernel
def _indices_in_heap(points, rotation, origin, normals, offsets, opening, half_width):  # type: ignore[no-untyped-def]
    """See `OpenContainer.indices_in_heap`."""
    lip_x, lip_z, way_x, way_z, out_x, out_z, length, height = opening
    rows = np.empty(len(points), dtype=np.intp)
    count = 0
    for i in range(len(points)):
        a, b, c = points[i, 0] - origin[0], points[i, 1] - origin[1], points[i, 2] - origin[2]
        x = a * rotation[0, 0] + b * rotation[1, 0] + c * rotation[2, 0]
        y = a * rotation[0, 1] + b * rotation[1, 1] + c * rotation[2, 1]
        z = a * rotation[0, 2] + b * rotation[1, 2] + c * rotation[2, 2]
        if not abs(y) <= half_width:
            continue
        along = (x - lip_x) * way_x + (z - lip_z) * way_z
        above = (x - lip_x) * out_x + (z - lip_z) * out_z
        inside = 0.0 <= along <= length and 0.0 <= above <= height
        if not inside:
            inside = True
            for k in range(len(offsets)):
                inside &= normals[k, 0] * x + normals[k, 1] * z <= offsets[k] + 1e-12
        if inside:
            rows[count] = i
            count += 1
    return rows[:count].copy()
