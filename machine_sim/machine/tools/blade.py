"""Shape of a dozer blade: one curved plate that cuts with its lower edge and pushes soil ahead.

Side view in the frame of the link that carries it, x forward, y to the left; the profile runs from
the cutting edge to the top edge::

        z     3   top edge
        ^     |
        |    2        soil is ahead of the plate, at +x;
        |    |        the back of the plate is at -x
        |     '1
        |       '0   cutting edge
        o---------------------> x
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine.box import Box
from machine_sim.machine.errors import MachineError

if TYPE_CHECKING:
    from machine_sim.machine.spec_file.section import Section

__all__ = ["BladeShape"]

Array = NDArray[np.float64]

_MIN_PROFILE_POINTS = 2


@dataclass(frozen=True, eq=False)
class BladeShape:
    """A plate with a profile that rises from the cutting edge, drawn across a width.

    Attributes:
        profile: points (x, z) [m] from cutting edge to top edge, z increasing, shape (n, 2).
        width: length of the cutting edge [m].
        plate_thickness: thickness of the plate as drawn [m]; the physics treats it as thin.
    """

    kind: ClassVar[str] = "blade"
    spins: ClassVar[bool] = False
    can_carry_soil: ClassVar[bool] = False

    profile: Array
    width: float
    plate_thickness: float = 0.03

    def __post_init__(self) -> None:
        """
        Raises:
            MachineError: fewer than two points, a profile that does not rise, or a size that is
                not above 0.
        """
        profile = np.array(self.profile, dtype=np.float64)
        if profile.ndim != 2 or profile.shape[1] != 2 or len(profile) < _MIN_PROFILE_POINTS:
            raise MachineError(
                f"blade.profile has shape {profile.shape}; give {_MIN_PROFILE_POINTS} or more"
                " points [x, z]"
            )
        if not (np.isfinite(profile).all() and (np.diff(profile[:, 1]) > 0.0).all()):
            raise MachineError(
                "blade.profile does not rise from the cutting edge to the top edge; give finite"
                " points [x, z] with increasing z"
            )
        for name in ("width", "plate_thickness"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise MachineError(f"blade.{name} is {value}; give a number of metres above 0")
        profile.setflags(write=False)
        object.__setattr__(self, "profile", profile)

    @classmethod
    def from_section(cls, section: Section) -> Self:
        """Read the blade from a tool's section of a machine file.

        Raises:
            MachineError: a missing key or a value out of range.
        """
        return cls(
            profile=np.array(section.vectors("profile", None, 2)),
            width=section.number("width", positive=True),
            plate_thickness=section.number("plate_thickness", positive=True),
        )

    @cached_property
    def key_points(self) -> Array:
        """Key points [m], shape (2 * n, 3): row 2k left, 2k + 1 right, cutting edge first."""
        return np.stack([self._side(+1), self._side(-1)], axis=1).reshape(-1, 3)

    @cached_property
    def outward_normals(self) -> Array:
        """Unit normals of the back of the plate at each pair of key points, shape (n, 3)."""
        edges = np.diff(self.profile, axis=0)
        normals = np.column_stack([-edges[:, 1], edges[:, 0]])
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        at_points = np.vstack([normals[:1], normals[:-1] + normals[1:], normals[-1:]])
        at_points /= np.linalg.norm(at_points, axis=1, keepdims=True)
        return np.column_stack([at_points[:, 0], np.zeros(len(at_points)), at_points[:, 1]])

    def plates(self) -> list[Array]:
        """Return the strips of the plate as planar polygons [m], shape (4, 3) each."""
        left, right = self._side(+1), self._side(-1)
        return [
            np.array([left[k + 1], left[k], right[k], right[k + 1]])
            for k in range(len(self.profile) - 1)
        ]

    def boxes(self) -> list[Box]:
        """Return a box for each strip of the plate."""
        boxes = []
        for a, b in pairwise(self.profile):
            middle, edge = 0.5 * (a + b), b - a
            boxes.append(
                Box(
                    (float(np.hypot(*edge)), self.width, self.plate_thickness),
                    (float(middle[0]), 0.0, float(middle[1])),
                    math.atan2(-edge[1], edge[0]),
                )
            )
        return boxes

    @property
    def capacity(self) -> float:
        """Loose volume ahead of a straight blade [m^3]: 0.8 W H^2 (SAE J1265)."""
        return 0.8 * self.width * self._height**2

    def indices_ahead(self, points: Array, rotation: Array, origin: Array) -> NDArray[np.intp]:
        """Return the rows of the points that the blade pushes ahead, in ascending order.

        They are at most two blade heights ahead of its plate, and half a height above or below it.

        Args:
            points: points [m], map frame, shape (n, 3), float64.
            rotation, origin: pose of the frame of the blade in the map frame.
        """
        local = (points - origin) @ rotation
        x, z = self.profile.T
        height = self._height
        distance = local[:, 0] - np.interp(local[:, 2], z, x)
        is_ahead = (distance >= 0.0) & (distance <= 2.0 * height)
        is_ahead &= np.abs(local[:, 2] - 0.5 * (z[0] + z[-1])) <= height
        is_ahead &= np.abs(local[:, 1]) <= 0.5 * self.width
        return np.flatnonzero(is_ahead)

    @property
    def _height(self) -> float:
        """Height of the blade [m]."""
        return float(self.profile[-1, 1] - self.profile[0, 1])

    def release_points(self, points: ArrayLike, clearance: float, up: Array) -> Array:
        """Return points [m], shape (n, 3), moved to `clearance` [m] or more ahead of the plate."""
        released = np.array(points, dtype=np.float64).reshape(-1, 3)
        x, z = self.profile.T
        half_width = max(0.5 * self.width - clearance, 0.0)
        released[:, 1] = np.clip(released[:, 1], -half_width, half_width)
        released[:, 2] = np.clip(released[:, 2], z[0], z[-1])
        released[:, 0] = np.maximum(released[:, 0], np.interp(released[:, 2], z, x) + clearance)
        return released

    def _side(self, side: int) -> Array:
        """Return the profile at the left (+1) or right (-1) end, shape (n, 3)."""
        y = np.full(len(self.profile), 0.5 * side * self.width)
        return np.column_stack([self.profile[:, 0], y, self.profile[:, 1]])
