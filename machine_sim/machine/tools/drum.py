"""Shape of a cutting drum: a cylinder with picks that rotates about y of its frame.

The envelope of the pick tips cuts. The body of the drum pushes the cuttings, together with a few
vanes that stand for the helical rows of picks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from machine_sim.machine.box import Box
from machine_sim.machine.errors import MachineError

if TYPE_CHECKING:
    from machine_sim.machine.spec_file.section import Section

__all__ = ["DrumShape"]

Array = NDArray[np.float64]

_NUM_KEY_POINT_PAIRS = 12
"""Number of pairs of key points on the circle of the tips; the polygon is within 3.5 % of it."""
_NUM_BODY_FLATS = 8
"""Number of flats of the body."""
_VANE_THICKNESS = 0.04
"""Thickness of the vanes as drawn [m]."""


@dataclass(frozen=True, eq=False)
class DrumShape:
    """A drum with picks.

    Attributes:
        radius: distance of the pick tips from the axis [m].
        body_radius: radius of the body [m].
        width: length along the axis [m].
        offset: position of the middle along the axis in the link frame, positive to the left [m].
        vanes: number of vanes.
    """

    kind: ClassVar[str] = "drum"
    spins: ClassVar[bool] = True
    can_carry_soil: ClassVar[bool] = False

    radius: float
    body_radius: float
    width: float
    offset: float = 0.0
    vanes: int = 4

    def __post_init__(self) -> None:
        """
        Raises:
            MachineError: numbers out of range.
        """
        if not (0.0 < self.body_radius < self.radius < math.inf):
            raise MachineError(
                f"drum.body_radius is {self.body_radius} m and drum.radius {self.radius} m; give"
                " 0 < body_radius < radius"
            )
        if not 0.0 < self.width < math.inf:
            raise MachineError(f"drum.width is {self.width}; give a number of metres above 0")
        if self.vanes < 1:
            raise MachineError(f"drum.vanes is {self.vanes}; give one or more")

    @classmethod
    def from_section(cls, section: Section) -> Self:
        """Read the drum from a tool's section of a machine file.

        Raises:
            MachineError: a missing key or a value out of range.
        """
        return cls(
            radius=section.number("radius", positive=True),
            body_radius=section.number("body_radius", positive=True),
            width=section.number("width", positive=True),
            offset=section.number("offset"),
            vanes=section.count("vanes", low=1),
        )

    @cached_property
    def key_points(self) -> Array:
        """Pick tips [m], shape (26, 3): row 2k left, 2k + 1 right, last pair equal to the first."""
        left, right = (self._rim(_NUM_KEY_POINT_PAIRS, self.radius, side) for side in (1, -1))
        ring = np.stack([left, right], axis=1)
        return np.concatenate([ring, ring[:1]]).reshape(-1, 3)

    def plates(self) -> list[Array]:
        """Return flats and ends of the body and the vanes as convex planar polygons [m]."""
        left, right = (self._rim(_NUM_BODY_FLATS, self.body_radius, side) for side in (1, -1))
        flats = [
            np.array([left[k], left[k - 1], right[k - 1], right[k]]) for k in range(_NUM_BODY_FLATS)
        ]
        roots = [self._rim(self.vanes, 0.98 * self.body_radius, side) for side in (1, -1)]
        tips = [self._rim(self.vanes, self.radius, side) for side in (1, -1)]
        vanes = [
            np.array([roots[0][k], tips[0][k], tips[1][k], roots[1][k]]) for k in range(self.vanes)
        ]
        return [*flats, left, right[::-1].copy(), *vanes]

    def boxes(self) -> list[Box]:
        """Return an octagon of four boxes, and a box for each vane."""
        flat = 2.0 * self.body_radius * math.tan(math.pi / 8)
        boxes = [
            Box(
                (2.0 * self.body_radius, self.width, flat),
                (0.0, self.offset, 0.0),
                0.25 * math.pi * k,
            )
            for k in range(4)
        ]
        middle, height = 0.5 * (self.body_radius + self.radius), self.radius - self.body_radius
        for k in range(self.vanes):
            angle = 2.0 * math.pi * k / self.vanes
            at = (middle * math.cos(angle), self.offset, -middle * math.sin(angle))
            boxes.append(Box((height, self.width, _VANE_THICKNESS), at, angle))
        return boxes

    def release_points(self, points: ArrayLike, clearance: float, up: Array) -> Array:
        """Return release points outside the drum on its upper half; see `CuttingShape`.

        Soil that is cut below the axis is moved around the drum by the picks, to the same
        horizontal distance from the axis.
        """
        local = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        half_width = max(0.5 * self.width - clearance, 0.0)
        lateral = self.offset + np.clip(local[:, 1] - self.offset, -half_width, half_width)
        length = float(np.hypot(up[0], up[2]))
        # With a vertical axis no side of the drum is the upper one; any direction will do.
        upward = up[[0, 2]] / length if length > 1e-3 else np.array([1.0, 0.0])
        horizontal = np.array([upward[1], -upward[0]])
        sine = np.clip(local[:, [0, 2]] @ horizontal / self.radius, -0.9, 0.9)
        direction = sine[:, None] * horizontal + np.sqrt(1.0 - sine**2)[:, None] * upward
        released = (self.radius + clearance) * direction
        return np.column_stack([released[:, 0], lateral, released[:, 1]])

    def _rim(self, count: int, radius: float, side: int) -> Array:
        """Return points on the circle at one end, from x toward -z, shape (count, 3)."""
        angle = 2.0 * math.pi * np.arange(count) / count
        y = np.full(count, self.offset + 0.5 * side * self.width)
        return np.column_stack([radius * np.cos(angle), y, -radius * np.sin(angle)])
