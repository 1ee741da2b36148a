"""Shape of a truck's bed or of a bin: plates in contact with soil, and capacities.

Side view in the frame of the link that carries it, x forward. The points run from the rear rim,
over which it empties, along the floor to the front rim::

        z                3 front rim
        ^                |
        |  0.            |         the opening is between 3 and 0
        |    '1----------2
        o---------------------> x
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from machine_sim.machine.tools.open_container import OpenContainer

if TYPE_CHECKING:
    from machine_sim.machine.spec_file.section import Section

__all__ = ["BedShape"]

_MIN_PROFILE_POINTS = 3

_HEAP_SLOPE = 0.5
"""Slope of the heap that counts for the heaped capacity, height over width."""


@dataclass(frozen=True, eq=False)
class BedShape(OpenContainer):
    """A bed with parallel sides, open at the top; attributes as in `OpenContainer`."""

    kind: ClassVar[str] = "bed"

    profile: NDArray[np.float64]
    width: float
    plate_thickness: float = 0.02

    def __post_init__(self) -> None:
        """
        Raises:
            MachineError: the profile has fewer than three points, is not convex or is clockwise.
        """
        self._validate("bed", _MIN_PROFILE_POINTS)

    @cached_property
    def heaped_capacity(self) -> float:
        """Struck volume and a 2:1 heap on the opening [m^3], as ISO 6483 rates dumper bodies.

        The heap of an excavator's bucket is 1:1: a bed is hauled, and its load settles.
        """
        heap = super().heaped_capacity - self.struck_capacity
        return self.struck_capacity + _HEAP_SLOPE * heap

    @classmethod
    def from_section(cls, section: Section) -> Self:
        """Read the bed from a tool's section of a machine file.

        Raises:
            MachineError: a missing key or a value out of range.
        """
        return cls(
            profile=np.array(section.vectors("profile", None, 2)),
            width=section.number("width", positive=True),
            plate_thickness=section.number("plate_thickness", positive=True),
        )
