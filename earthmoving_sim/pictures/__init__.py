"""Pictures of a site before and after a run, each one PNG file.

- `site_record`: SiteRecord, the only input of all pictures
- `map_window`: Window, to_image: the part of the map that is shown, x right and y up
- `style`: colours, type sizes, and figures laid out in inches
- `plan_view`: surface_image: the ground from above with hillshade and contours
- `cut_fill`: draw_cut_fill: before, after, and their difference with its volumes
- `bucket_path`: draw_bucket_path: path of the lip from above, from the side and over its length
- `mesh`: the worked ground as triangles
- `rasterizer`: visible triangle of each pixel
- `shading`: sunlight, shadow and sky light of the visible triangles
- `site_3d`: draw_site_3d: pit and spoil heap in 3-D at true scale
- `machine_view`: draw_machine: a machine on its own
"""

from earthmoving_sim.pictures.bucket_path import draw_bucket_path
from earthmoving_sim.pictures.cut_fill import draw_cut_fill
from earthmoving_sim.pictures.map_window import Window, to_image
from earthmoving_sim.pictures.plan_view import surface_image
from earthmoving_sim.pictures.site_3d import draw_site_3d
from earthmoving_sim.pictures.site_record import SiteRecord

__all__ = [
    "SiteRecord",
    "Window",
    "draw_bucket_path",
    "draw_cut_fill",
    "draw_site_3d",
    "surface_image",
    "to_image",
]
