"""State of the terrain: the soil of every column, and what a tick changed.

- `state`: volumes, kinds and moistures of all columns, and the height they reach
- `occupancy`: marks of columns that a tool is in, or that are in its lee
- `operations`: kernels that add soil to one column, remove it and compact it
- `grid_frame`: rows, columns and origin of the grid, for kernels
- `changes`: which columns a tick changed, by how much, and the material of their surface
- `tile_checksum`: running volume of the terrain, and the hash of its state
"""

from soil_sim.columns.changes import ChangeTracker, ColumnChanges
from soil_sim.columns.state import ColumnArrays, Columns, SurfaceMaterial
from soil_sim.columns.tile_checksum import TileChecksums

__all__ = [
    "ChangeTracker",
    "ColumnArrays",
    "ColumnChanges",
    "Columns",
    "SurfaceMaterial",
    "TileChecksums",
]
