"""Pictures of what a run did to its site, each one PNG file.

record      SiteRecord: what there is to draw, the only input
window      Window, to_image: the part of the map that is shown, x right and y up
plan        surface_image: the ground seen from above, with hillshade and contours
style       colours, type sizes and figures laid out in inches
cut_fill    draw_cut_fill: before, after, and the difference with its volumes
bucket_path draw_bucket_path: where the lip went, from above and from the side
scene       the worked ground and the machine as a mesh
raster      which triangle of a mesh each pixel sees
shading     sun, shadow and sky on what the pixels see
site_3d     draw_site_3d: pit and spoil heap in 3-D at true scale
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
