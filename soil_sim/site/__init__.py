"""Site of a run: initial terrain and design.

- `design`: design surface, and cut and fill against it
- `site`: parameters of a site, and the terrain, layers and design that they describe
"""

from soil_sim.site.design import CutFill, DesignSurface, compare_to_design, load_design
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
