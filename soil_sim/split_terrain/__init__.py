"""Prototype: the terrain split among several soils, each of which owns a slab of it.

- `slabs`: rows of the grid that each region owns, and the halo around them
- `halo_soil`: kinds of soil of the halo, which do not slide
- `region`: the soil of one region
- `border_link`: numbered rows from a region to its neighbour
- `tool_shares`: which regions a tool sweeps, and its share in each
- `split_soil`: all regions, with the interface of one soil

See `docs/concepts/split_terrain.md`. The regions run in one process; there is no node for them yet.
"""

from soil_sim.split_terrain.split_soil import SplitSoil

__all__ = ["SplitSoil"]
