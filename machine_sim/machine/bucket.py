"""Shape of a bucket: plates for collision, key points for cutting, capacities for the payload.

Side view in the bucket frame, origin at the bucket pin, y toward the reader's back (left)::

        z
        ^     .--3--.            belly at +z: with the arm folded, a positive bucket angle
        |   4'       '2          turns the mouth up and draws the lip toward the machine
        |  5            '1
        | 6 - - mouth - - '0     0 = cutting lip (1.45, 0), 6 = upper rim
        o-------------------> x  o = bucket pin
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine.errors import MachineError

__all__ = ["KEY_PAIRS", "BucketShape"]

KEY_PAIRS = 7
"""Pairs of key points along the bucket's side edges, as many as the reference work uses."""

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BucketShape:
    """A bucket with parallel sides: a convex profile drawn across its width.

    Attributes:
        profile: key points (x, z) [m] in the bucket frame from the cutting lip along floor, heel
            and back to the upper rim, shape (7, 2); the mouth closes it.
        width: inside width [m].
        plate: thickness of the plates as drawn [m]; the physics takes them as thin.
    """

    profile: Array
    width: float
    plate: float = 0.03

    def __post_init__(self) -> None:
        """
        Raises:
            MachineError: a profile that is not seven points, not convex, or wound backwards.
        """
        profile = np.array(self.profile, dtype=np.float64)
        if profile.shape != (KEY_PAIRS, 2) or not np.isfinite(profile).all():
            raise MachineError(
                f"bucket.profile has shape {profile.shape}; give {KEY_PAIRS} finite points [x, z]"
            )
        if not (np.isfinite(self.width) and self.width > 0.0):
            raise MachineError(f"bucket.width is {self.width}; give a number of metres above 0")
        if not (np.isfinite(self.plate) and self.plate > 0.0):
            raise MachineError(f"bucket.plate is {self.plate}; give a number of metres above 0")
        if profile[0, 1] != 0.0 or profile[0, 0] <= 0.0:
            raise MachineError(
                "bucket.profile[0] is the cutting lip and lies on the x axis of the bucket frame;"
                f" give [length, 0.0] instead of {profile[0].tolist()}"
            )
        edge = np.roll(profile, -1, axis=0) - profile
        turn = edge[:, 0] * np.roll(edge[:, 1], -1) - edge[:, 1] * np.roll(edge[:, 0], -1)
        # All turns one way is not enough: a star turns one way too, but more than once round.
        heading = np.unwrap(np.arctan2(edge[:, 1], edge[:, 0]))
        if not (turn > 1e-12).all() or heading[-1] - heading[0] > 2.0 * np.pi:
            worst = int(np.argmin(turn) + 1) % KEY_PAIRS
            raise MachineError(
                f"bucket.profile is not convex with its belly at +z (look at point {worst});"
                " give the points from the lip round the heel to the rim, turning one way"
            )
        profile.setflags(write=False)
        object.__setattr__(self, "profile", profile)

    @property
    def tip_length(self) -> float:
        """Bucket pin to cutting lip [m]."""
        return float(self.profile[0, 0])

    @cached_property
    def mouth_length(self) -> float:
        """Cutting lip to upper rim [m]."""
        return float(np.hypot(*(self.profile[-1] - self.profile[0])))

    @cached_property
    def mouth_normal(self) -> Array:
        """Unit normal of the mouth plane, out of the bucket, bucket frame, shape (3,)."""
        dx, dz = (self.profile[-1] - self.profile[0]) / self.mouth_length
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
        a, b = sorted((self.mouth_length, self.width))
        return self.struck_capacity + a * a * (3.0 * b - a) / 12.0

    def plates(self) -> list[Array]:
        """Inside faces of the shell as convex planar polygons, bucket frame [m].

        Returns:
            Six floor strips, shape (4, 3) each, lip first, then the left and the right side,
            shape (7, 3). Corners run counter-clockwise seen from outside the bucket.
        """
        left, right = self._edge(+1), self._edge(-1)
        strips = [
            np.array([left[k], left[k + 1], right[k + 1], right[k]]) for k in range(KEY_PAIRS - 1)
        ]
        return [*strips, left[::-1].copy(), right]

    @cached_property
    def key_points(self) -> Array:
        """Key points [m], bucket frame, shape (14, 3): row 2k left, 2k+1 right, lip first."""
        return np.stack([self._edge(+1), self._edge(-1)], axis=1).reshape(-1, 3)

    @cached_property
    def outward_normals(self) -> Array:
        """Unit outward normal of the shell at each pair of key points, shape (7, 3).

        Between two strips it halves their angle; at lip and rim it is that of the only strip.
        """
        strips = self._half_planes[0][:-1]
        normals = np.vstack([strips[:1], strips[:-1] + strips[1:], strips[-1:]])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return np.column_stack([normals[:, 0], np.zeros(KEY_PAIRS), normals[:, 1]])

    def contains(self, points_local: ArrayLike) -> NDArray[np.bool_]:
        """Which points [m], bucket frame, shape (n, 3), lie in the struck volume; shape (n,)."""
        points = np.asarray(points_local, dtype=np.float64).reshape(-1, 3)
        normals, offsets = self._half_planes
        inside = (points[:, [0, 2]] @ normals.T <= offsets + 1e-12).all(axis=1)
        return np.asarray(inside & (np.abs(points[:, 1]) <= 0.5 * self.width), dtype=np.bool_)

    def contains_heaped(self, points_local: ArrayLike) -> NDArray[np.bool_]:
        """Like `contains`, or in the room of a heap: the mouth prism, as high as the heap's ridge.

        The prism reaches half the mouth's shorter side above the mouth plane.
        """
        points = np.asarray(points_local, dtype=np.float64).reshape(-1, 3)
        lip, rim = self.profile[0], self.profile[-1]
        from_lip = points[:, [0, 2]] - lip
        along = from_lip @ ((rim - lip) / self.mouth_length)
        above = from_lip @ self.mouth_normal[[0, 2]]
        heap = (along >= 0.0) & (along <= self.mouth_length) & (above >= 0.0)
        heap &= above <= 0.5 * min(self.mouth_length, self.width)
        heap &= np.abs(points[:, 1]) <= 0.5 * self.width
        return self.contains(points) | np.asarray(heap, dtype=np.bool_)

    def clamped_inside(self, points_local: ArrayLike, clearance: float) -> Array:
        """Points moved into the struck volume, at least `clearance` [m] away from every plate.

        A point that is there already stays; another goes straight toward the bucket's middle in
        the side view, and straight inward across the width.

        Args:
            points_local: points [m], bucket frame, shape (n, 3).
            clearance: distance kept from the plates, not from the open mouth.

        Raises:
            MachineError: the bucket is too small for that clearance.
        """
        points = np.array(points_local, dtype=np.float64).reshape(-1, 3)
        normals, offsets = self._half_planes
        middle = self.profile.mean(axis=0)
        limit = offsets.copy()
        limit[:-1] -= clearance
        room = limit - normals @ middle
        if not (clearance >= 0.0 and (room > 0.0).all() and 2.0 * clearance < self.width):
            raise MachineError(f"a clearance of {clearance} m leaves no room; give a smaller one")
        side = 0.5 * self.width - clearance
        points[:, 1] = np.clip(points[:, 1], -side, side)
        arm = points[:, [0, 2]] - middle
        reach = arm @ normals.T
        share = np.where(reach > room, room / np.where(reach > room, reach, 1.0), 1.0)
        points[:, [0, 2]] = middle + arm * share.min(axis=1, keepdims=True)
        return points

    @cached_property
    def _half_planes(self) -> tuple[Array, Array]:
        """Outward normals (7, 2) and offsets (7,) of strips and mouth (last): inside n.p <= d."""
        edge = np.roll(self.profile, -1, axis=0) - self.profile
        normals = np.column_stack([edge[:, 1], -edge[:, 0]])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return normals, np.einsum("ij,ij->i", normals, self.profile)

    def _edge(self, side: int) -> Array:
        """The profile on the left (+1) or right (-1) side, shape (7, 3)."""
        y = np.full(KEY_PAIRS, 0.5 * side * self.width)
        return np.column_stack([self.profile[:, 0], y, self.profile[:, 1]])
