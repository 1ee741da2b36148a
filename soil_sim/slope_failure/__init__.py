"""Slope failure: soil steeper than its angle of repose slides down (reference, section 3.1.2).

- `relaxation`: the columns to relax, and which of the algorithms below is the cheapest
- `runout`: deposited soil runs down to where it stays
- `relax_cells`: columns in a queue give soil to their neighbours, one by one
- `relax_window`: large failures, relaxed in passes over a window; `window`: its bounds;
  `window_surface`: its copy; `relax_pairs`: the kernels of a pass; `retained_pairs`: what a tool
  is between; `redistribute`: what the passes planned, as whole mm^3
- `stability`: critical height of firm soil
- `relaxation_parameters`, `neighbourhood`, `cell_queue`: data that the algorithms share
- `noise`: random variation of the angle of repose and of the direction of sliding
- `slope_excess`: how much steeper than allowed a terrain is
"""

from soil_sim.slope_failure.neighbourhood import gauss_circle_offsets
from soil_sim.slope_failure.noise import RelaxationNoise, relaxation_noise, surface_tilt
from soil_sim.slope_failure.relaxation import SlopeRelaxation
from soil_sim.slope_failure.runout import ColumnShares

__all__ = [
    "ColumnShares",
    "RelaxationNoise",
    "SlopeRelaxation",
    "gauss_circle_offsets",
    "relaxation_noise",
    "surface_tilt",
]
