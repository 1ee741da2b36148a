"""Kinds of soil for the halo of a region: they bear tools as usual, and never slide or fail.

The columns of a halo belong to a neighbour, which alone decides what slides from them. They have a
height, and no soil: `soil_sim.split_terrain.region`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

from soil_sim.soils.params import SoilParams
from soil_sim.soils.soil_types import SoilType

__all__ = ["HaloSoilType", "RegionParams"]

_UPRIGHT = math.atan(1e6)
"""Slope [rad] at which soil of the halo would slide; no two columns are that steep."""


@dataclass(frozen=True)
class HaloSoilType(SoilType):
    """A kind of soil with the strength of another one, that neither slides, fails nor is packed."""

    @classmethod
    def like(cls, kind: SoilType) -> HaloSoilType:
        """Return the kind for the halo of a kind of soil."""
        return cls(**_values(kind) | {"shrinkage": 0.0})

    def repose_angle_at(self, moisture: float) -> float:
        """Return the angle of repose [rad] at a moisture [%]."""
        return _UPRIGHT


@dataclass(frozen=True)
class RegionParams(SoilParams):
    """Parameters of the soil of a region: each kind of soil again, as kind of the halo."""

    @classmethod
    def of(cls, params: SoilParams, soil_depth: float) -> RegionParams:
        """Return the parameters of a region.

        Args:
            params: parameters of the whole terrain.
            soil_depth: depth of the floor below the lowest point of the region [m].
        """
        return cls(**_values(params) | {"soil_depth": soil_depth})

    def soil_types(self) -> tuple[SoilType, ...]:
        """Return the kinds of soil, followed by their kinds for the halo in the same order."""
        kinds = super().soil_types()
        return (*kinds, *map(HaloSoilType.like, kinds))


def _values(parameters: SoilType | SoilParams) -> dict[str, Any]:
    return {field.name: getattr(parameters, field.name) for field in fields(parameters)}
