"""Site of a run: initial terrain and design.

- `design`: design surface, given or read from a terrain file
- `cut_fill`: cut and fill volumes between the ground and a design
- `site`: parameters of a site, and the terrain, layers and design that they describe
"""

from soil_sim.site.cut_fill import CutFill, compare_to_design
from soil_sim.site.design import DesignSurface, load_design
from soil_sim.site.site import Site, SiteParams, make_site

__all__ = [
    "CutFill",
    "DesignSurface",
    "Site",
    "SiteParams",
    "compare_to_design",
    "load_design",
    "make_site",
]
