"""Shape of a bucket: plates in contact with soil, key points for cutting, and capacities.

Side view in the bucket frame, with its origin at the bucket pin and y (left) into the page::

        z
        ^     .--3--.            The floor is at +z: with the arm folded, a positive bucket
        |   4'       '2          angle turns the opening up and the lip toward the machine.
        |  5            '1
        | 6 - - opening - '0     0: cutting lip (1.45, 0), 6: upper rim
        o-------------------> x  o: bucket pin
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine.errors import MachineError
from machine_sim.machine.tools.open_container import OpenContainer

if TYPE_CHECKING:
    from machine_sim.machine.spec_file.section import Section

__all__ = ["NUM_KEY_POINT_PAIRS", "BucketShape"]

NUM_KEY_POINT_PAIRS = 7
"""Number of pairs of key points along the bucket's side edges, as in the 2014 reference."""

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BucketShape(OpenContainer):
    """A bucket with parallel sides: a convex profile, extruded across its width.

    Attributes:
        profile: key points (x, z) [m] in the bucket frame from the cutting lip along floor, heel
            and back to the upper rim, shape (7, 2).
        width: inside width [m].
        plate_thickness: thickness of the plates as drawn [m]; the physics treats them as thin.
    """

    kind: ClassVar[str] = "bucket"

    profile: Array
    width: float
    plate_thickness: float = 0.03

    def __post_init__(self) -> None:
        """
        Raises:
            MachineError: the profile does not have seven points, is not convex or is clockwise.
        """
        if np.shape(self.profile) != (NUM_KEY_POINT_PAIRS, 2):
            raise MachineError(
                f"bucket.profile has shape {np.shape(self.profile)}; give {NUM_KEY_POINT_PAIRS}"
                " points [x, z]"
            )
        lip = np.asarray(self.profile, dtype=np.float64)[0]
        if lip[1] != 0.0 or lip[0] <= 0.0:
            raise MachineError(
                f"bucket.profile[0] is {lip.tolist()}; give [length, 0.0], the cutting lip on the"
                " x axis of the bucket frame"
            )
        self._validate("bucket", NUM_KEY_POINT_PAIRS)

    @classmethod
    def from_section(cls, section: Section) -> Self:
        """Read the bucket from a tool's section of a machine file.

        Raises:
            MachineError: a missing key or a value out of range.
        """
        return cls(
            profile=np.array(section.vectors("profile", NUM_KEY_POINT_PAIRS, 2)),
            width=section.number("width", positive=True),
            plate_thickness=section.number("plate_thickness", positive=True),
        )

    @property
    def tip_radius(self) -> float:
        """Distance from bucket pin to cutting lip [m]."""
        return float(self.profile[0, 0])

    @cached_property
    def key_points(self) -> Array:
        """Key points [m], bucket frame, shape (14, 3): row 2k left, 2k + 1 right, lip first."""
        return np.stack([self._edge(+1), self._edge(-1)], axis=1).reshape(-1, 3)

    @cached_property
    def outward_normals(self) -> Array:
        """Unit outward normal of the shell at each pair of key points, shape (7, 3).

        Between two strips it bisects the angle between their normals.
        """
        strips = self.half_planes.normals[:-1]
        normals = np.vstack([strips[:1], strips[:-1] + strips[1:], strips[-1:]])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return np.column_stack([normals[:, 0], np.zeros(NUM_KEY_POINT_PAIRS), normals[:, 1]])

    def release_points(self, points: ArrayLike, clearance: float, up: Array) -> Array:
        """Return points inside the bucket for excavated soil; see `CuttingShape.release_points`."""
        return self.clamp_inside(points, min(clearance, self._max_clearance))

    @cached_property
    def _max_clearance(self) -> float:
        """Half of the largest distance from all plates that a point in the bucket can have [m]."""
        distances = (self.half_planes.offsets - self._distances_of_middle)[:-1]
        return 0.5 * min(0.5 * self.width, float(distances.min()))

    @cached_property
    def _middle(self) -> Array:
        """Middle of the profile (x, z) [m], shape (2,)."""
        return np.asarray(self.profile.mean(axis=0), dtype=np.float64)

    @cached_property
    def _distances_of_middle(self) -> Array:
        """Product of each normal of the half-planes with the middle of the profile [m]."""
        return self.half_planes.normals @ self._middle

    def clamp_inside(self, points_local: ArrayLike, clearance: float) -> Array:
        """Return points moved into the struck volume, at `clearance` [m] or more from all plates.

        Points that are already there are unchanged. The others move straight toward the middle of
        the profile in the side view, and straight inward across the width.

        Args:
            points_local: points [m], bucket frame, shape (n, 3).
            clearance: minimum distance from the plates, but not from the opening.

        Raises:
            MachineError: the bucket is too small for the clearance.
        """
        points = np.array(points_local, dtype=np.float64).reshape(-1, 3)
        normals, offsets = self.half_planes
        middle = self._middle
        limit = offsets.copy()
        limit[:-1] -= clearance
        max_distance = limit - self._distances_of_middle
        if not (clearance >= 0.0 and (max_distance > 0.0).all() and 2.0 * clearance < self.width):
            raise MachineError(
                f"a clearance of {clearance} m leaves no space in the bucket; give a smaller one"
            )
        half_width = 0.5 * self.width - clearance
        points[:, 1] = np.minimum(np.maximum(points[:, 1], -half_width), half_width)
        offset = points[:, [0, 2]] - middle
        distance = offset @ normals.T
        is_outside = distance > max_distance
        factor = np.where(is_outside, max_distance / np.where(is_outside, distance, 1.0), 1.0)
        points[:, [0, 2]] = middle + offset * factor.min(axis=1, keepdims=True)
        return points
