"""Position of a map in a coordinate reference system."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from soil_sim.errors import TerrainError, TerrainErrorCode

__all__ = ["Georeference"]


@dataclass(frozen=True)
class Georeference:
    """Position of the origin of the map frame, whose x is east and y north (ENU, REP 103).

    Attributes:
        crs: a projected coordinate reference system in metres, as "EPSG:<code>" or WKT; empty
            if only the coordinates are known.
        easting: easting of the centre of the map [m].
        northing: northing of the centre of the map [m].
        elevation: elevation of z = 0 above the vertical datum of the system [m].

    Raises:
        TerrainError: crs is not a text, or a coordinate is not a finite number.
    """

    crs: str
    easting: float
    northing: float
    elevation: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.crs, str):
            raise TerrainError(
                f"crs is {self.crs!r}; give it as text: an EPSG code or WKT",
                TerrainErrorCode.GEOREFERENCE,
            )
        for name in ("easting", "northing", "elevation"):
            value = getattr(self, name)
            is_real = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not (is_real and math.isfinite(value)):
                raise TerrainError(
                    f"{name} is {value!r}; give a finite number of metres",
                    TerrainErrorCode.GEOREFERENCE,
                )

    def translated(self, east: float, north: float, up: float = 0.0) -> Georeference:
        """Return the georeference of a map whose origin is displaced by this vector [m]."""
        return dataclasses.replace(
            self,
            easting=self.easting + east,
            northing=self.northing + north,
            elevation=self.elevation + up,
        )
