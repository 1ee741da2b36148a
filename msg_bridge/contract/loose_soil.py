"""Parameters of a soil type that machines need: of the loose soil in tools and under tracks."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from msg_bridge.contract.errors import ParameterError

__all__ = ["LooseSoil"]


@dataclass(frozen=True)
class LooseSoil:
    """Parameters of a soil type once excavated, and under tracks.

    Triples are values at 0, 50 and 100 % of saturation, with linear interpolation between them. A
    plate of width b sinks to the depth z under the pressure
    (bekker_k_c / b + bekker_k_phi) z^bekker_n (Bekker).

    Attributes:
        swell: loose volume over bank volume, minus 1.
        density: density of undisturbed (bank) soil [kg/m^3].
        repose_angles: angles of repose [deg].
        cohesion: cohesion of dry undisturbed soil [Pa].
        adhesion: adhesion of dry soil to steel along its surface [Pa].
        normal_adhesion: adhesion across its surface, the tensile stress at which dry soil comes off
            [Pa]; 0: as `adhesion`.
        moisture_strength_factors: cohesion and adhesion over their values in dry soil.
        contact_areas: area on which lumps touch one another or steel, over their cross section:
            dry lumps touch at a few spots, plastic ones spread.
        tool_friction: angle of friction against steel [deg].
        size_spread: largest volume of a lump over the mean volume, minus 1.
        moisture: initial moisture [% of saturation].
        internal_friction: angle of internal friction [deg].
        bekker_k_c: cohesive modulus of sinkage k_c of dry soil [N/m^(n + 1)].
        bekker_k_phi: frictional modulus of sinkage k_phi of dry soil [N/m^(n + 2)]; 0: no sinkage,
            and the traction of tracks is limited by friction against steel.
        bekker_n: exponent of sinkage n.
        moisture_bearing_factors: both moduli over their values in dry soil.
        janosi_k: shear deformation modulus K of Janosi and Hanamoto [m]: at this displacement the
            soil mobilises 63 % of its shear strength.

    Raises:
        ParameterError: a value outside its range.
    """

    swell: float = 0.0
    density: float = 1600.0
    repose_angles: tuple[float, float, float] = (30.0, 30.0, 30.0)
    cohesion: float = 0.0
    adhesion: float = 0.0
    normal_adhesion: float = 0.0
    moisture_strength_factors: tuple[float, float, float] = (1.0, 1.0, 1.0)
    contact_areas: tuple[float, float, float] = (0.05, 0.05, 0.05)
    tool_friction: float = 20.0
    size_spread: float = 0.0
    moisture: int = 0
    internal_friction: float = 30.0
    bekker_k_c: float = 0.0
    bekker_k_phi: float = 0.0
    bekker_n: float = 1.0
    moisture_bearing_factors: tuple[float, float, float] = (1.0, 1.0, 1.0)
    janosi_k: float = 0.01

    def __post_init__(self) -> None:
        """Check the ranges of all values."""
        for name in (
            "repose_angles",
            "moisture_strength_factors",
            "contact_areas",
            "moisture_bearing_factors",
        ):
            if not isinstance(getattr(self, name), tuple) or len(getattr(self, name)) != 3:
                raise ParameterError(
                    f"{name} of a loose soil are {getattr(self, name)}; give three values"
                )
        for name, value, low, high in (
            ("swell", self.swell, 0.0, 2.0),
            ("density", self.density, 1.0, 1e5),
            *(("repose_angles", angle, 0.0, 90.0) for angle in self.repose_angles),
            ("cohesion", self.cohesion, 0.0, 1e9),
            ("adhesion", self.adhesion, 0.0, 1e9),
            ("normal_adhesion", self.normal_adhesion, 0.0, 1e9),
            *(("contact_areas", area, 0.0, 1.0) for area in self.contact_areas),
            *(
                ("moisture_strength_factors", factor, 0.0, 1e3)
                for factor in self.moisture_strength_factors
            ),
            ("tool_friction", self.tool_friction, 0.0, 89.0),
            ("size_spread", self.size_spread, 0.0, 0.9),
            ("moisture", self.moisture, 0.0, 100.0),
            ("internal_friction", self.internal_friction, 0.0, 89.0),
            ("bekker_k_c", self.bekker_k_c, 0.0, 1e12),
            ("bekker_k_phi", self.bekker_k_phi, 0.0, 1e12),
            ("bekker_n", self.bekker_n, 0.01, 3.0),
            *(
                ("moisture_bearing_factors", factor, 0.0, 1e3)
                for factor in self.moisture_bearing_factors
            ),
            ("janosi_k", self.janosi_k, 1e-4, 1.0),
        ):
            if isinstance(value, tuple) or not (math.isfinite(value) and low <= value <= high):
                raise ParameterError(
                    f"{name} of a loose soil is {value}; give a value from {low:g} to {high:g}"
                )

    def repose_angle(self, moisture: float) -> float:
        """Return the angle of repose [deg] at a moisture [% of saturation]."""
        return float(np.interp(moisture, (0.0, 50.0, 100.0), self.repose_angles))

    def contact_area(self, moisture: float) -> float:
        """Return the area of contact of lumps over their cross section at a moisture [%]."""
        return float(np.interp(moisture, (0.0, 50.0, 100.0), self.contact_areas))

    def moisture_bearing_factor(self, moisture: float) -> float:
        """Return the moduli of sinkage over those of dry soil at a moisture [% of saturation]."""
        return float(np.interp(moisture, (0.0, 50.0, 100.0), self.moisture_bearing_factors))

    def moisture_strength_factor(self, moisture: float) -> float:
        """Return cohesion and adhesion over those of dry soil at a moisture [% of saturation]."""
        return float(np.interp(moisture, (0.0, 50.0, 100.0), self.moisture_strength_factors))
