"""State of the hydraulic cylinders of one joint."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["CylinderState"]


class CylinderState(NamedTuple):
    """State of the parallel cylinders that drive one joint.

    Attributes:
        length: distance from pin to pin [m].
        speed: extension speed [m/s], negative for retraction.
        force: total force of the parallel cylinders [N], positive for a push.
        cap_side_pressure, rod_side_pressure: pressures on the two sides of the piston [Pa].
    """

    length: float
    speed: float
    force: float
    cap_side_pressure: float
    rod_side_pressure: float
