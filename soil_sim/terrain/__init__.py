"""Where terrain comes from: heights in a grid, read from files, made, cropped and resampled."""

from soil_sim.terrain.files import SUFFIXES, load_terrain, save_terrain
from soil_sim.terrain.georeference import Georeference
from soil_sim.terrain.heights import HEIGHT_LIMIT, HeightMap
from soil_sim.terrain.made import flat, rough, slope
from soil_sim.terrain.north_up import from_north_up, to_north_up

__all__ = [
    "HEIGHT_LIMIT",
    "SUFFIXES",
    "Georeference",
    "HeightMap",
    "flat",
    "from_north_up",
    "load_terrain",
    "rough",
    "save_terrain",
    "slope",
    "to_north_up",
]
