"""Terrain heights and layers on a grid: synthetic, or read from files.

- `height_map`: heights on a grid; cropping, resampling, scaling
- `georeference`: position of a map in a coordinate reference system
- `north_up`: conversion between north-up images and the matrix order of the grid
- `synthetic`: level, sloping and rough terrain
- `raster`: contents of a file before spacing and scale are applied
- `numpy_files`, `png`, `ascii_grid`, `geotiff`: file formats
- `file_access`: suffixes, atomic writes and errors of files
- `files`: terrain files of any format
- `layers`: soil id and moisture of each cell
- `layer_files`: files of one layer
"""

from soil_sim.terrain.files import (
    SUFFIXES,
    load_heights_with_nodata,
    load_terrain,
    load_terrain_with_layers,
    save_terrain,
)
from soil_sim.terrain.georeference import Georeference
from soil_sim.terrain.height_map import HEIGHT_LIMIT, HeightMap
from soil_sim.terrain.layer_files import load_layer, save_layer
from soil_sim.terrain.layers import LAYER_KINDS, Layers, moisture_percent, soil_ids
from soil_sim.terrain.north_up import from_north_up, to_north_up
from soil_sim.terrain.synthetic import flat, rough, slope

__all__ = [
    "HEIGHT_LIMIT",
    "LAYER_KINDS",
    "SUFFIXES",
    "Georeference",
    "HeightMap",
    "Layers",
    "flat",
    "from_north_up",
    "load_heights_with_nodata",
    "load_layer",
    "load_terrain",
    "load_terrain_with_layers",
    "moisture_percent",
    "rough",
    "save_layer",
    "save_terrain",
    "slope",
    "soil_ids",
    "to_north_up",
]
