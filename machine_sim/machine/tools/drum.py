"""Shape of a cutting drum: a cylinder with picks that spins about its axis, y of its frame.

What cuts is the envelope of the picks' tips, what pushes the cuttings is the drum's body with a few
vanes on it, as the rows of picks on their scrolls are.
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
"""Pairs of key points round the tips: a polygon within 3.5 % of the circle."""
_NUM_BODY_FLATS = 8
"""Flats of the body."""
_VANE_THICKNESS = 0.04
"""Thickness of the vanes as drawn [m]."""


@dataclass(frozen=True, eq=False)
class DrumShape:
    """A drum with picks.

    Attributes:
        radius: to the tips of the picks [m].
        body: radius of the body [m].
        width: length along its axis [m].
        offset: of its middle from the origin of its link, along the axis, + to the left [m].
        vanes: rows of picks along it, that push.
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
                f"drum.body_radius is {self.body_radius} and radius {self.radius}; give a body above 0 m, and"
                " tips of the picks farther out than that"
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
        """Tips of the picks [m], shape (26, 3): row 2k left, 2k + 1 right, the ring closed."""
        left, right = (self._rim(_NUM_KEY_POINT_PAIRS, self.radius, side) for side in (1, -1))
        ring = np.stack([left, right], axis=1)
        return np.concatenate([ring, ring[:1]]).reshape(-1, 3)

    def plates(self) -> list[Array]:
        """The body's flats and ends and the vanes, as convex planar polygons [m]."""
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
        middle, high = 0.5 * (self.body_radius + self.radius), self.radius - self.body_radius
        for k in range(self.vanes):
            angle = 2.0 * math.pi * k / self.vanes
            at = (middle * math.cos(angle), self.offset, -middle * math.sin(angle))
            boxes.append(Box((high, self.width, _VANE_THICKNESS), at, angle))
        return boxes

    def release_points(self, points: ArrayLike, clearance: float, up: Array) -> Array:
        """Where soil that is cut at some points comes loose: out of the drum, on its upper half.

        What is cut below the axis comes round with the picks to as far in front of it.

        Args:
            points: [m], in a frame that has the drum's origin and axis and does not spin, (n, 3).
            clearance: kept from the tips [m].
            up: unit vector, same frame.
        """
        local = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        half = max(0.5 * self.width - clearance, 0.0)
        along = self.offset + np.clip(local[:, 1] - self.offset, -half, half)
        upright = float(np.hypot(up[0], up[2]))
        # Of a drum that lies on its end no side is up: one is as good as another.
        rise = up[[0, 2]] / upright if upright > 1e-3 else np.array([1.0, 0.0])
        level = np.array([rise[1], -rise[0]])
        across = np.clip(local[:, [0, 2]] @ level / self.radius, -0.9, 0.9)
        way = across[:, None] * level + np.sqrt(1.0 - across**2)[:, None] * rise
        placed = (self.radius + clearance) * way
        return np.column_stack([placed[:, 0], along, placed[:, 1]])

    def _rim(self, count: int, radius: float, side: int) -> Array:
        """Points round one end, shape (count, 3); they turn from x toward -z, as a joint does."""
        angle = 2.0 * math.pi * np.arange(count) / count
        y = np.full(count, self.offset + 0.5 * side * self.width)
        return np.column_stack([radius * np.cos(angle), y, -radius * np.sin(angle)])
