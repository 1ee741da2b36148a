"""A machine on its own, to check a machine file by eye."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.image import imsave

from earthmoving_sim.coloured_mesh import ColouredMesh, merge_meshes
from earthmoving_sim.pictures.rasterizer import Camera
from earthmoving_sim.pictures.shading import render

__all__ = ["draw_machine"]

_HEIGHT_PX = 700
_BORDER_M = 0.4
_AZIMUTHS = (np.radians(90.0), np.radians(42.0))
_ELEVATIONS = (np.radians(4.0), np.radians(20.0))
_GROUND = (0.62, 0.57, 0.49)


def draw_machine(mesh: ColouredMesh, path: Path) -> Path:
    """Write a picture of a machine that stands at the origin, from the side and from the front.

    Args:
        mesh: triangles of the machine.
        path: path of the PNG.

    Returns:
        The path.
    """
    scene = merge_meshes(mesh, _ground(mesh))
    views = []
    for azimuth, elevation in zip(_AZIMUTHS, _ELEVATIONS, strict=True):
        camera = Camera(float(azimuth), float(elevation))
        corners = camera.view(scene.points)[:, :2]
        low, size = corners.min(axis=0), np.ptp(corners, axis=0)
        shape = (_HEIGHT_PX, round(_HEIGHT_PX * size[0] / size[1]))
        views.append(render(scene, camera, low, _HEIGHT_PX / size[1], shape))
    picture = np.concatenate(views, axis=1)
    white = picture[..., :3] * picture[..., 3:] + 1.0 - picture[..., 3:]
    imsave(path, np.clip(white, 0.0, 1.0), origin="lower")
    return path


def _ground(mesh: ColouredMesh) -> ColouredMesh:
    """Return a rectangle under a machine."""
    low, high = mesh.points.min(axis=0) - _BORDER_M, mesh.points.max(axis=0) + _BORDER_M
    corners = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    return ColouredMesh(
        points=np.array([(x, y, 0.0) for x, y in corners]),
        normals=np.tile([0.0, 0.0, 1.0], (4, 1)),
        colours=np.tile(_GROUND, (4, 1)),
        triangles=np.array([[0, 1, 2], [0, 2, 3]], dtype=np.intp),
        parts=np.zeros(2, dtype=np.intp),
    )
