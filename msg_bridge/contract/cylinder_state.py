"""How a hydraulic cylinder is doing, as the machine tells it."""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["CylinderState"]


class CylinderState(NamedTuple):
    """The cylinders that turn one joint.

    Attributes:
        length: from pin to pin [m].
        speed: of its growth [m/s].
        force: push of all side by side [N], negative for a pull.
        head_pressure, rod_pressure: on the two sides of the piston [Pa].
    """

    length: float
    speed: float
    force: float
    head_pressure: float
    rod_pressure: float
