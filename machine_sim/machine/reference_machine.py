"""Published figures of real machines, with which a machine file can be compared."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

__all__ = ["FIGURE_UNITS", "ReferenceMachine"]

FIGURE_UNITS: Mapping[str, str] = {
    "operating_mass": "kg",
    "engine_power": "kW",
    "pump_flow": "l/min",
    "main_relief_pressure": "MPa",
    "travel_relief_pressure": "MPa",
    "swing_relief_pressure": "MPa",
    "swing_torque": "kN m",
    "swing_speed": "rpm",
    "travel_speed": "km/h",
    "heaped_capacity": "m3",
    "drawbar_pull": "kN",
    "bucket_force": "kN",
    "arm_force": "kN",
    "boom_raise_time": "s",
    "boom_lower_time": "s",
    "arm_in_time": "s",
    "arm_out_time": "s",
    "bucket_in_time": "s",
    "bucket_out_time": "s",
}
"""Units of brochures, by the name of the figure."""


@dataclass(frozen=True)
class ReferenceMachine:
    """A real machine.

    Attributes:
        name: manufacturer and model.
        source: document that the figures are from.
        figures: published values in the units of `FIGURE_UNITS`, by name.
    """

    name: str
    source: str
    figures: Mapping[str, float]
