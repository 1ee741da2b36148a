"""Neighbouring pairs of particles: a Verlet list with the contact history of its pairs.

In the order of the algorithm:

- `skin_widths`: how far ahead the list searches, and when it expires
- `cell_grid`: particles sorted into cells
- `pair_table`: the list as arrays
- `pair_search`: pairs found cell by cell; `neighbourhood`: pairs of one particle
- `history_transfer`: contact history carried over from the previous list
- `list_build`: these stages, in one call
- `spring_history`: springs of pairs asleep, which are not listed
- `pair_updates`: insertion and removal of particles without a rebuild
- `verlet_list`: the list, rebuilt when it expires
"""

from machine_sim.dem.neighbours.cell_grid import spatial_order
from machine_sim.dem.neighbours.pair_table import PairArrays, PairTable
from machine_sim.dem.neighbours.verlet_list import VerletList

__all__ = ["PairArrays", "PairTable", "VerletList", "spatial_order"]
