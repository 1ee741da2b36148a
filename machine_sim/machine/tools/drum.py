"""Shape of a cutting drum: a cylinder with picks that rotates about y of its frame.

The envelope of the pick tips cuts. Cuttings touch the same envelope, as a smooth cylinder with the
friction of the soil on steel: the helical rows of picks carry them along like a screw, they do not
paddle. A body with radial vanes would drag lumps through the gap between the body and the face and
spend thirty times the work of cutting loam on them.

Cuttings come loose on the free side of the drum, opposite to the face, where the picks throw them.
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
from msg_bridge.kernels import kernel

if TYPE_CHECKING:
    from machine_sim.machine.spec_file.section import Section

__all__ = ["DrumShape"]

Array = NDArray[np.float64]

_NUM_KEY_POINT_PAIRS = 16
"""Number of pairs of key points on the circle of the tips; the polygon is within 2 % of it."""
_NUM_FLATS = 16
"""Number of flats of the envelope that cuttings touch."""
_END_CORNERS = 8
"""Maximum number of corners of a plate: the ends consist of several."""
_MIN_RELEASE_SINE, _MAX_RELEASE_SINE = 0.2, 0.85
"""Range of the sine of the angle below the axis at which cuttings come loose."""
_VANE_THICKNESS = 0.04
"""Thickness of the vanes as drawn [m]."""


@dataclass(frozen=True, eq=False)
class DrumShape:
    """A drum with picks.

    Attributes:
        radius: distance of the pick tips from the axis [m].
        body_radius: radius of the body that other machines touch [m].
        width: length along the axis [m].
        offset: position of the middle along the axis in the link frame, positive to the left [m].
        vanes: number of helical rows of picks on each half, as drawn.
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
        """Pick tips [m], shape (34, 3): row 2k left, 2k + 1 right, last pair equal to the first."""
        left, right = (self._rim(_NUM_KEY_POINT_PAIRS, self.radius, side) for side in (1, -1))
        ring = np.stack([left, right], axis=1)
        return np.concatenate([ring, ring[:1]]).reshape(-1, 3)

    def plates(self) -> list[Array]:
        """Return flats and ends of the envelope of the pick tips as convex planar polygons [m]."""
        left, right = (self._rim(_NUM_FLATS, self.radius, side) for side in (1, -1))
        flats = [
            np.array([left[k], left[k - 1], right[k - 1], right[k]]) for k in range(_NUM_FLATS)
        ]
        return [*flats, *_fan(left), *_fan(right[::-1])]

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
        """Return release points outside the drum on its free side; see `CuttingShape`.

        The free side is opposite to the mean of the points, at and below the height of the axis:
        soil that is cut there would be squeezed between the drum and the face. Each point keeps
        its position along the axis and its order in height.
        """
        released: Array = _release_points(
            np.asarray(points, dtype=np.float64).reshape(-1, 3),
            (float(up[0]), float(up[2])),
            float(np.hypot(up[0], up[2])),
            self.radius,
            clearance,
            self.offset,
            max(0.5 * self.width - clearance, 0.0),
        )
        return released

    def _rim(self, count: int, radius: float, side: int) -> Array:
        """Return points on the circle at one end, from x toward -z, shape (count, 3)."""
        angle = 2.0 * math.pi * np.arange(count) / count
        y = np.full(count, self.offset + 0.5 * side * self.width)
        return np.column_stack([radius * np.cos(angle), y, -radius * np.sin(angle)])


@kernel
def _release_points(points, up, length, radius, clearance, offset, half_width):  # type: ignore[no-untyped-def]
    """Return `DrumShape.release_points`.

    Args:
        points: points [m], drum frame, shape (n, 3).
        up: x and z of the vertical in the drum frame.
        length: length of that vector.
        radius, clearance: of the drum, and of the released points from it [m].
        offset, half_width: middle and half length of the range along the axis [m].
    """
    # With a vertical axis no side of the drum is the upper one; any direction will do.
    up_x, up_z = (up[0] / length, up[1] / length) if length > 1e-3 else (0.0, 1.0)
    forward_x, forward_z = up_z, -up_x
    total = 0.0
    for i in range(len(points)):
        total += points[i, 0] * forward_x + points[i, 2] * forward_z
    side = -1.0 if total >= 0.0 else 1.0
    span = _MAX_RELEASE_SINE - _MIN_RELEASE_SINE
    released = np.empty_like(points)
    for i in range(len(points)):
        height = (points[i, 0] * up_x + points[i, 2] * up_z) / radius
        height = min(max(height, -1.0), 1.0)
        sine = _MIN_RELEASE_SINE + 0.5 * span * (1.0 - height)
        cosine = side * math.sqrt(1.0 - sine * sine)
        released[i, 0] = (radius + clearance) * (cosine * forward_x - sine * up_x)
        released[i, 1] = offset + min(max(points[i, 1] - offset, -half_width), half_width)
        released[i, 2] = (radius + clearance) * (cosine * forward_z - sine * up_z)
    return released


def _fan(rim: Array) -> list[Array]:
    """Return the polygon of a rim [m], shape (n, 3), as convex polygons of a few corners."""
    last = len(rim) - 1
    return [
        np.concatenate([rim[:1], rim[k : k + _END_CORNERS - 1]])
        for k in range(1, last, _END_CORNERS - 2)
    ]
