"""Hydraulic cylinders: areas of their pistons, and the force that a pressure gives.

The geometry between a cylinder and the joint that it drives is in `cylinder_linkage`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

from machine_sim.machine.cylinder_linkage import CylinderLinkage

__all__ = ["Cylinder"]


@dataclass(frozen=True)
class Cylinder:
    """Parallel cylinders that drive one joint.

    Attributes:
        linkage: geometry between cylinder and joint.
        bore, rod_diameter: inner diameter of the barrel, and diameter of the rod [m].
        count: number of cylinders.
        spread: lateral distance between the outer cylinders [m].
        cushion_length: length of the cushion at both ends of the stroke [m].
        max_flow: maximum flow that its valves let through, of one pump or of all [m^3/s].
    """

    linkage: CylinderLinkage
    bore: float
    rod_diameter: float
    count: int
    spread: float
    cushion_length: float
    max_flow: float

    @cached_property
    def cap_side_area(self) -> float:
        """Area of all pistons on the cap side [m^2]."""
        return 0.25 * math.pi * self.count * self.bore**2

    @cached_property
    def rod_side_area(self) -> float:
        """Area of all pistons on the rod side [m^2]."""
        return 0.25 * math.pi * self.count * (self.bore**2 - self.rod_diameter**2)

    def force_limit(self, pressure: float, back_pressure: float, *, is_extending: bool) -> float:
        """Return the maximum force [N] with `pressure` on the driving side of the pistons [Pa].

        Args:
            pressure: pressure on the driving side [Pa].
            back_pressure: pressure on the other side [Pa].
            is_extending: whether the cap side drives, so that the cylinder pushes.
        """
        driving, opposing = self.cap_side_area, self.rod_side_area
        if not is_extending:
            driving, opposing = opposing, driving
        return pressure * driving - back_pressure * opposing
