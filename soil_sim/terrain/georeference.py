"""Where on Earth a map lies: kept from the file it came from, and written back with it."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from soil_sim.errors import TerrainError

__all__ = ["Georeference"]


@dataclass(frozen=True)
class Georeference:
    """Place of the map frame's origin, with x east and y north (ENU, REP 103), both unturned.

    Attributes:
        crs: a projected coordinate reference system in metres, as "EPSG:<code>" or WKT; empty
            where the coordinates are known but their system is not.
        easting: easting of the map's centre [m].
        northing: northing of the map's centre [m].
        elevation: elevation of the map's z = 0 above the system's vertical datum [m].

    Raises:
        TerrainError: a crs that is no text, or a coordinate that is no finite number.
    """

    crs: str
    easting: float
    northing: float
    elevation: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.crs, str):
            raise TerrainError(f"crs is {self.crs!r}; give it as text: an EPSG code or WKT")
        for name in ("easting", "northing", "elevation"):
            value = getattr(self, name)
            real = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not (real and math.isfinite(value)):
                raise TerrainError(f"{name} is {value!r}; give a finite number of metres")

    def translated(self, east: float, north: float, up: float = 0.0) -> Georeference:
        """The georeference of a map whose origin lies this much further [m] in this map frame."""
        return dataclasses.replace(
            self,
            easting=self.easting + east,
            northing=self.northing + north,
            elevation=self.elevation + up,
        )
