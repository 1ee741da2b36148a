"""How particles of a soil touch: friction, rolling resistance, stickiness, by soil and moisture."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.state import ParticleError
from msg_bridge.contract.loose_soil import LooseSoil

__all__ = ["ContactMaterials"]

_SATURATED = 100
"""Highest moisture [% of saturation]."""

_REPOSE_ANGLE_TABLE = (
    (10.0, 0.03, 0.0),
    (17.0, 0.08, 0.006),
    (19.5, 0.10, 0.01),
    (23.7, 0.20, 0.02),
    (27.6, 0.30, 0.03),
    (30.4, 0.30, 0.05),
    (33.4, 0.30, 0.09),
    (37.9, 0.35, 0.155),
    (40.7, 0.40, 0.20),
    (44.8, 0.60, 0.30),
)
"""Angle of repose [deg] that some thousands pour to, by friction and rolling friction; a mean of
several pours, of which each is off by a degree."""

_PACKING_FRACTION_TABLE = ((15.0, 0.66), (30.0, 0.60), (45.0, 0.60))
"""Part of the room of a heap that is particles, by its angle of repose [deg]."""

_CONTACT_AREA_FRACTION = 0.05
"""Part of a particle's cross section on which it sticks. Cohesion and adhesion are measured over
faces that touch all over; lumps touch at a few spots."""

_BOND_STEEPENING_TABLE = ((0.0, 0.0), (0.2, 3.4), (0.4, 5.8), (0.9, 11.5), (2.0, 15.0))
"""By *bond number*, the force that parts two particles over the weight of one: how much steeper
[deg] they pour where they hold together. An angle of repose is measured on soil as it coheres, so
that so much less of it is left to friction."""

_GRAVITY = 9.81
_TOOL_ROLLING_FRICTION = 0.1
"""Rolling friction on steel."""


def _contact_coefficients(
    repose_angle: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Friction and rolling friction by angle of repose [deg], where nothing coheres."""
    angle, friction, rolling_friction = (
        list(column) for column in zip(*_REPOSE_ANGLE_TABLE, strict=True)
    )
    return np.interp(repose_angle, angle, friction), np.interp(
        repose_angle, angle, rolling_friction
    )


class ContactMaterials:
    """Contact properties, by soil and moisture, shape (soils, 101), float32.

    Attributes:
        friction, rolling: between particles.
        cohesion: pressure that holds two together, on the smaller's cross section [Pa].
        tool_friction, tool_rolling_friction: at a tool.
        adhesion: pressure that holds one to a tool [Pa].
        packing: part of the room of a heap that is particles.
        swell, density: of each soil, shape (soils,), see `LooseSoil`.
    """

    def __init__(self, soils: Sequence[LooseSoil], nominal_volume: float) -> None:
        """
        Args:
            soils: by id.
            nominal_volume: bank volume of a particle [mm^3]; the smaller, the more of its angle of
                repose a soil owes to cohesion.

        Raises:
            ParticleError: no soil.
        """
        if not soils:
            raise ParticleError("particles need a soil; give one at least")
        shape = (len(soils), _SATURATED + 1)
        self.friction = np.zeros(shape, np.float32)
        self.rolling_friction = np.zeros(shape, np.float32)
        self.packing = np.zeros(shape, np.float32)
        self.cohesion = np.zeros(shape, np.float32)
        self.adhesion = np.zeros(shape, np.float32)
        self.tool_friction = np.zeros(shape, np.float32)
        self.tool_rolling_friction = np.full(shape, _TOOL_ROLLING_FRICTION, np.float32)
        self.swell = np.array([soil.swell for soil in soils])
        self.density = np.array([soil.density for soil in soils])
        heap, packing = (list(column) for column in zip(*_PACKING_FRACTION_TABLE, strict=True))
        bond, steepening = (list(column) for column in zip(*_BOND_STEEPENING_TABLE, strict=True))
        for k, soil in enumerate(soils):
            self.tool_friction[k] = math.tan(math.radians(soil.tool_friction))
            angles = np.array([soil.repose_angle(m) for m in range(_SATURATED + 1)])
            sticks = np.array([soil.moisture_strength_factor(m) for m in range(_SATURATED + 1)])
            self.packing[k] = np.interp(angles, heap, packing)
            self.cohesion[k] = _CONTACT_AREA_FRACTION * soil.cohesion * sticks
            self.adhesion[k] = _CONTACT_AREA_FRACTION * soil.adhesion * sticks
            steeper = np.interp(self._bond_numbers(k, 1e-9 * nominal_volume), bond, steepening)
            self.friction[k], self.rolling_friction[k] = _contact_coefficients(angles - steeper)

    def radius(
        self, bank: NDArray[np.floating], soil: NDArray[np.int64], moisture: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Of spheres [m] that fill the room of loose soil of some bank volumes [m^3]."""
        bulk = bank * (1.0 + self.swell[soil])
        return np.asarray(np.cbrt(0.75 / math.pi * bulk * self.packing[soil, moisture]))

    def _bond_numbers(self, soil: int, bank: float) -> NDArray[np.float64]:
        """Of particles of a bank volume [m^3], by moisture, shape (101,)."""
        moisture = np.arange(_SATURATED + 1)
        kind = np.full_like(moisture, soil)
        area = math.pi * self.radius(np.full(moisture.size, bank), kind, moisture) ** 2
        weight = bank * self.density[soil] * _GRAVITY
        return np.asarray(area * self.cohesion[soil] / weight)

    def validate_soil_ids(self, soil: NDArray[np.integer]) -> None:
        """Refuse soils that are not in the tables.

        Raises:
            ParticleError: one is not.
        """
        if soil.size and int(soil.max()) >= len(self.swell):
            raise ParticleError(
                f"soil {soil.max()} is not known, only {len(self.swell)} soils are; give the engine"
                " all soils of the terrain"
            )
