"""What a machine must know of a kind of soil: how it is once it is loose, and to drive on."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from msg_bridge.contract.errors import ParameterError

__all__ = ["LooseSoil"]


@dataclass(frozen=True)
class LooseSoil:
    """A kind of soil once it is dug, and under tracks.

    Triples hold at 0, 50 and 100 % of saturation. A plate of breadth b sinks z deep into it under
    the pressure (bekker_k_c / b + bekker_k_phi) z^bekker_n (Bekker).

    Attributes:
        swell: loose volume over bank volume, minus 1.
        density: of undisturbed (bank) soil [kg/m^3].
        repose_angles: slope beyond which a heap of it slips [deg].
        cohesion, adhesion: of undisturbed soil, dry, and to steel [Pa].
        stick: cohesion and adhesion over those when dry.
        tool_friction: angle of friction against steel [deg].
        spread: of the sizes of its lumps: the largest volume over the mean, minus 1.
        moisture: as found [% of saturation].
        internal_friction: angle of internal friction [deg].
        bekker_k_c: Bekker's modulus k_c, dry [N/m^(n + 1)].
        bekker_k_phi: Bekker's modulus k_phi, dry [N/m^(n + 2)]; 0: it does not give, and tracks
            grip it as friction of steel lets them.
        bekker_n: Bekker's n.
        bearing: both moduli over those when dry.
        janosi_k: Janosi's and Hanamoto's K [m]: sheared so far, soil resists with 63 % of its
            strength.

    Raises:
        ParameterError: a figure that no soil has.
    """

    swell: float = 0.0
    density: float = 1600.0
    repose_angles: tuple[float, float, float] = (30.0, 30.0, 30.0)
    cohesion: float = 0.0
    adhesion: float = 0.0
    moisture_strength_factors: tuple[float, float, float] = (1.0, 1.0, 1.0)
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
        """Check the figures."""
        for name in ("repose_angles", "moisture_strength_factors", "moisture_bearing_factors"):
            if not isinstance(getattr(self, name), tuple) or len(getattr(self, name)) != 3:
                raise ParameterError(
                    f"{name} of a loose soil are {getattr(self, name)}; give three"
                )
        for name, value, low, high in (
            ("swell", self.swell, 0.0, 2.0),
            ("density", self.density, 1.0, 1e5),
            *(("repose_angles", angle, 0.0, 90.0) for angle in self.repose_angles),
            ("cohesion", self.cohesion, 0.0, 1e9),
            ("adhesion", self.adhesion, 0.0, 1e9),
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
        """Slope beyond which a heap slips [deg], at a moisture [% of saturation]."""
        return float(np.interp(moisture, (0.0, 50.0, 100.0), self.repose_angles))

    def moisture_bearing_factor(self, moisture: float) -> float:
        """Bekker's moduli over those when dry, at a moisture [% of saturation]."""
        return float(np.interp(moisture, (0.0, 50.0, 100.0), self.moisture_bearing_factors))

    def moisture_strength_factor(self, moisture: float) -> float:
        """Cohesion and adhesion over those when dry, at a moisture [% of saturation]."""
        return float(np.interp(moisture, (0.0, 50.0, 100.0), self.moisture_strength_factors))
