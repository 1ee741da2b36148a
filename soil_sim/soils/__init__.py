"""Kinds of soil and the parameters that select them.

- `soil_types`: properties of kinds of soil, read from a file, and their tables for kernels
- `params`: parameters of the soil of a run
"""

from soil_sim.soils.params import SoilParams
from soil_sim.soils.soil_types import SoilTables, SoilType, build_soil_tables, load_soil_types

__all__ = ["SoilParams", "SoilTables", "SoilType", "build_soil_tables", "load_soil_types"]
