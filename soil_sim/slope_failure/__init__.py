"""Slip: soil that is too steep moves down (reference, section 3.1.2).

- `slip`: which columns may be too steep, and which of the ways below is least work
- `pour`: soil that comes runs down to where it stays
- `examine`: columns that wait give to their neighbours, one by one
- `collapse`: large failures are swept, all at once, and `book`: what that moved, exactly
- `face`: how high firm soil stands
- `rule`: what all these share; `noise`: unevenness of nature, by seed
"""

from soil_sim.slope_failure.relaxation import RelaxationNoise, SlopeRelaxation, gauss_circle_offsets

__all__ = ["RelaxationNoise", "SlopeRelaxation", "gauss_circle_offsets"]
