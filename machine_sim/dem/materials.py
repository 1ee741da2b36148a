"""Contact coefficients of particles by soil type and moisture, calibrated to the soil's properties.

Friction and rolling friction are chosen so that particles pour to the soil's angle of repose, less
the part of it that is due to cohesion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem.state import ParticleError
from msg_bridge.contract.constants import GRAVITY, MOISTURE_LEVELS
from msg_bridge.contract.loose_soil import LooseSoil

__all__ = ["ContactCoefficients", "ContactMaterials"]

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
"""Angle of repose [deg] of some thousand cohesionless particles, friction and rolling friction
coefficient. The angles are means of several pours, which differ by a degree."""

_PACKING_FRACTION_TABLE = ((15.0, 0.66), (30.0, 0.60), (45.0, 0.60))
"""Angle of repose [deg] and packing fraction of a heap."""

_BOND_STEEPENING_TABLE = ((0.0, 0.0), (0.2, 3.4), (0.4, 5.8), (0.9, 11.5), (2.0, 15.0))
"""Bond number, the cohesion force of two particles over the weight of one, and the increase of the
angle of repose by cohesion [deg]. A soil's angle of repose is measured with its cohesion, so that
friction accounts only for the rest."""

_TOOL_ROLLING_FRICTION = 0.1
"""Rolling friction coefficient on steel."""


class ContactCoefficients(NamedTuple):
    """Contact coefficients of some particles, shape (n,) each, as in `ParticleState`.

    Attributes:
        friction, rolling_friction: coefficients between particles.
        cohesion: cohesion of two particles [Pa], on the cross section of the smaller one.
        tool_friction, tool_rolling_friction: coefficients at a tool.
        adhesion: adhesion to a tool [Pa], on a particle's cross section.
    """

    friction: NDArray[np.floating]
    rolling_friction: NDArray[np.floating]
    cohesion: NDArray[np.floating]
    tool_friction: NDArray[np.floating]
    tool_rolling_friction: NDArray[np.floating]
    adhesion: NDArray[np.floating]


class ContactMaterials:
    """Tables of contact coefficients, by soil type and moisture.

    Attributes:
        packing: packing fraction of a heap, shape (soils, MOISTURE_LEVELS), float32.
        swell, density: of each soil type, shape (soils,), float64, see `LooseSoil`.
    """

    def __init__(self, soils: Sequence[LooseSoil], nominal_volume: float) -> None:
        """Compute the tables.

        Args:
            soils: soil types in the order of their ids.
            nominal_volume: bank volume of a particle [mm^3]; the smaller it is, the larger the part
                of the angle of repose that is due to cohesion.

        Raises:
            ParticleError: no soil type.
        """
        if not soils:
            raise ParticleError("particles need a soil type; give at least one")
        shape = (len(soils), MOISTURE_LEVELS)
        self.packing = np.zeros(shape, np.float32)
        self._coefficients = np.zeros((*shape, len(ContactCoefficients._fields)), np.float32)
        self.swell = np.array([soil.swell for soil in soils])
        self.density = np.array([soil.density for soil in soils])
        for k, soil in enumerate(soils):
            self._fill_tables(k, soil, nominal_volume)

    def _fill_tables(self, k: int, soil: LooseSoil, nominal_volume: float) -> None:
        """Fill row `k` of the tables."""
        repose_angle = np.array([soil.repose_angle(m) for m in range(MOISTURE_LEVELS)])
        strength = np.array([soil.moisture_strength_factor(m) for m in range(MOISTURE_LEVELS)])
        self.packing[k] = np.interp(repose_angle, *_columns(_PACKING_FRACTION_TABLE))
        # Cohesion and adhesion are measured on faces in full contact.
        contact = np.array([soil.contact_area(m) for m in range(MOISTURE_LEVELS)])
        cohesion = np.asarray(contact * soil.cohesion * strength, dtype=np.float32)
        bond_number = self._bond_numbers(k, 1e-9 * nominal_volume, cohesion)
        steepening = np.interp(bond_number, *_columns(_BOND_STEEPENING_TABLE))
        angle, friction, rolling_friction = _columns(_REPOSE_ANGLE_TABLE)
        coefficients = ContactCoefficients(
            friction=np.interp(repose_angle - steepening, angle, friction),
            rolling_friction=np.interp(repose_angle - steepening, angle, rolling_friction),
            cohesion=cohesion,
            tool_friction=np.full(MOISTURE_LEVELS, math.tan(math.radians(soil.tool_friction))),
            tool_rolling_friction=np.full(MOISTURE_LEVELS, _TOOL_ROLLING_FRICTION),
            adhesion=contact * (soil.normal_adhesion or soil.adhesion) * strength,
        )
        for j, column in enumerate(coefficients):
            self._coefficients[k, :, j] = column

    def coefficients(
        self, soil: NDArray[np.int64], moisture: NDArray[np.int64]
    ) -> ContactCoefficients:
        """Return the coefficients of particles, shape (n,) each, float32.

        Args:
            soil, moisture: soil types and moistures [% of saturation], shape (n,).
        """
        return ContactCoefficients(*self._coefficients[soil, moisture].T)

    def radius(
        self, bank: NDArray[np.floating], soil: NDArray[np.int64], moisture: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Return the radii [m] of spheres that fill, when packed, the bulk volume of loose soil.

        Args:
            bank: bank volumes [m^3], shape (n,).
            soil, moisture: soil types and moistures [% of saturation], shape (n,).
        """
        bulk = bank * (1.0 + self.swell[soil])
        return np.asarray(np.cbrt(0.75 / math.pi * bulk * self.packing[soil, moisture]))

    def _bond_numbers(
        self, soil: int, bank: float, cohesion: NDArray[np.float32]
    ) -> NDArray[np.float64]:
        """Return the bond numbers of particles of a bank volume [m^3] and a cohesion [Pa]."""
        moisture = np.arange(MOISTURE_LEVELS)
        soils = np.full_like(moisture, soil)
        area = math.pi * self.radius(np.full(moisture.size, bank), soils, moisture) ** 2
        weight = bank * self.density[soil] * GRAVITY
        return np.asarray(area * cohesion / weight)

    def validate_soil_ids(self, soil: NDArray[np.integer]) -> None:
        """Check that soil types are in the tables.

        Raises:
            ParticleError: an unknown soil type.
        """
        if soil.size and int(soil.max()) >= len(self.swell):
            raise ParticleError(
                f"soil type {soil.max()} is unknown, as there are only {len(self.swell)}; give the"
                " engine all soil types of the terrain"
            )


def _columns(table: tuple[tuple[float, ...], ...]) -> NDArray[np.float64]:
    """Return the columns of a table as rows, shape (columns, entries)."""
    return np.array(table).T
