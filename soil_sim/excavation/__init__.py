"""Excavation: tools remove the soil that they sweep.

- `swept_cut`: the soil below the swept surface of the tools, weighted by area
- `displacement`: soil for which the tool has no room is pushed ahead
- `rasterize`: the swept surface of a tool, rasterized to subcolumns; `rasterize_triangle`: the
  triangles it is made of
- `rock_cut`: the same in ground with rock, which yields to the work of cutting only
- `milled_cut`: the same for a drum, as far as its work suffices
- `refined_columns`: columns that a tool is in, refined into subcolumns
- `keypoint_cut`: the digging rule of the 2014 reference
- `removed_soil`: records of the soil that both remove
"""

from soil_sim.excavation.keypoint_cut import KeyPointCut
from soil_sim.excavation.milled_cut import Milling
from soil_sim.excavation.removed_soil import RemovedSoil
from soil_sim.excavation.swept_cut import SweptCut

__all__ = ["KeyPointCut", "Milling", "RemovedSoil", "SweptCut"]
