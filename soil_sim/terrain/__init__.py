"""Where terrain comes from: heights in a grid, read from files, made, cropped and resampled."""

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
