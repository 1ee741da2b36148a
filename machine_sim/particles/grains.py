"""How particles of a soil touch: friction, rolling resistance, stickiness, by soil and moisture."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from machine_sim.particles.store import ParticleError
from msg_bridge.contract.loose_soil import LooseSoil

__all__ = ["GrainTables", "contact_coefficients"]

_WET = 100
"""Highest moisture [% of saturation]."""

_REPOSE = (
    (10.0, 0.03, 0.0),
    (17.0, 0.08, 0.006),
    (19.5, 0.10, 0.01),
    (23.7, 0.20, 0.02),
    (27.6, 0.30, 0.03),
    (30.4, 0.30, 0.05),
    (34.3, 0.30, 0.09),
    (39.5, 0.35, 0.155),
    (43.0, 0.40, 0.20),
    (47.0, 0.60, 0.30),
)
"""Angle of repose [deg] that 4000 particles pour to, by friction and rolling friction."""

_PACKING = ((15.0, 0.66), (30.0, 0.60), (45.0, 0.60))
"""Part of the room of a heap that is particles, by its angle of repose [deg]."""

_CONTACT_SHARE = 0.05
"""Part of a particle's cross section on which it sticks. Cohesion and adhesion are measured over
faces that touch all over; lumps touch at a few spots."""

_TOOL_ROLLING = 0.1
"""Rolling friction on steel."""


def contact_coefficients(repose_angle: float) -> tuple[float, float]:
    """Friction and rolling friction of particles that pour to an angle of repose [deg]."""
    angle, friction, rolling = zip(*_REPOSE, strict=True)
    return (
        float(np.interp(repose_angle, angle, friction)),
        float(np.interp(repose_angle, angle, rolling)),
    )


class GrainTables:
    """Contact properties, by soil and moisture, shape (soils, 101), float32.

    Attributes:
        friction, rolling: between particles.
        cohesion: pressure that holds two together, on the smaller's cross section [Pa].
        tool_friction, tool_rolling: at a tool.
        adhesion: pressure that holds one to a tool [Pa].
        packing: part of the room of a heap that is particles.
        swell, density: of each soil, shape (soils,), see `LooseSoil`.
    """

    def __init__(self, soils: Sequence[LooseSoil]) -> None:
        """
        Raises:
            ParticleError: no soil.
        """
        if not soils:
            raise ParticleError("particles need a soil; give one at least")
        shape = (len(soils), _WET + 1)
        self.friction = np.zeros(shape, np.float32)
        self.rolling = np.zeros(shape, np.float32)
        self.packing = np.zeros(shape, np.float32)
        self.cohesion = np.zeros(shape, np.float32)
        self.adhesion = np.zeros(shape, np.float32)
        self.tool_friction = np.zeros(shape, np.float32)
        self.tool_rolling = np.full(shape, _TOOL_ROLLING, np.float32)
        self.swell = np.array([soil.swell for soil in soils])
        self.density = np.array([soil.density for soil in soils])
        heap, packing = (list(column) for column in zip(*_PACKING, strict=True))
        for k, soil in enumerate(soils):
            self.tool_friction[k] = math.tan(math.radians(soil.tool_friction))
            for m in range(_WET + 1):
                self.friction[k, m], self.rolling[k, m] = contact_coefficients(soil.repose_angle(m))
                self.packing[k, m] = np.interp(soil.repose_angle(m), heap, packing)
                self.cohesion[k, m] = _CONTACT_SHARE * soil.cohesion * soil.sticks(m)
                self.adhesion[k, m] = _CONTACT_SHARE * soil.adhesion * soil.sticks(m)

    def check(self, soil: NDArray[np.integer]) -> None:
        """Refuse soils that are not in the tables.

        Raises:
            ParticleError: one is not.
        """
        if soil.size and int(soil.max()) >= len(self.swell):
            raise ParticleError(
                f"soil {soil.max()} is not known, only {len(self.swell)} soils are; give the engine"
                " all soils of the terrain"
            )
