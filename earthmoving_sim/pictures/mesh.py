"""The worked ground as triangles of a block."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from earthmoving_sim.coloured_mesh import ColouredMesh, merge_meshes
from earthmoving_sim.pictures.map_window import Window
from earthmoving_sim.pictures.plan_view import surface_normals
from earthmoving_sim.pictures.site_record import SiteRecord

__all__ = ["ground_mesh"]

GRASS, DRY_GRASS = (0.43, 0.49, 0.29), (0.58, 0.57, 0.38)
LOOSE, BANK = (0.56, 0.41, 0.27), (0.45, 0.31, 0.20)  # loose soil is drier, so lighter
TOPSOIL, SUBSOIL = (0.47, 0.36, 0.26), (0.74, 0.63, 0.50)  # sides of the block, top and bottom

LOOSE_M, CUT_M = 0.005, 0.02  # minimum depth of loose soil, and of a cut, drawn as bare soil [m]
GRAIN, PATCHES = 0.05, 0.6  # strength of the colour noise and of the grass patches
NOISE_SEED = 7  # fixed: the same record gives the same picture

BLOCK_DEPTH_M = 0.5  # depth of the block below its lowest point [m]


def ground_mesh(record: SiteRecord, window: Window) -> ColouredMesh:
    """Return the final ground as a block: two triangles between four columns each, and sides."""
    heights = window.crop(record.after)
    x, y = np.meshgrid(window.x, window.y)
    points = np.stack([x, y, heights], axis=-1)
    num_rows, num_cols = heights.shape
    top = ColouredMesh(
        points=points.reshape(-1, 3),
        normals=surface_normals(heights, record.grid.cell).reshape(-1, 3),
        colours=_ground_colours(record, window).reshape(-1, 3),
        triangles=_strip_triangles(num_rows, num_cols),
        parts=np.zeros(2 * (num_rows - 1) * (num_cols - 1), dtype=np.intp),
    )
    floor = float(heights.min()) - BLOCK_DEPTH_M
    sides = (
        (points[0], (0.0, -1.0, 0.0)),
        (points[-1], (0.0, 1.0, 0.0)),
        (points[:, 0], (-1.0, 0.0, 0.0)),
        (points[:, -1], (1.0, 0.0, 0.0)),
    )
    return merge_meshes(top, *(_side(edge, normal, floor) for edge, normal in sides))


def _strip_triangles(num_rows: int, num_cols: int) -> NDArray[np.intp]:
    """Return two triangles for each square of a lattice of points, shape (2 * squares, 3)."""
    index = np.arange(num_rows * num_cols).reshape(num_rows, num_cols)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    return np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3).astype(np.intp)


def _side(
    edge: NDArray[np.float64], normal: tuple[float, float, float], floor: float
) -> ColouredMesh:
    """Return a side of the block from an edge of the ground (k, 3) down to the floor [m]."""
    bottom = edge.copy()
    bottom[:, 2] = floor
    count = len(edge)
    triangles = _strip_triangles(2, count)
    return ColouredMesh(
        points=np.concatenate([edge, bottom]),
        normals=np.tile(normal, (2 * count, 1)),
        colours=np.repeat([TOPSOIL, SUBSOIL], count, axis=0),
        triangles=triangles,
        parts=np.zeros(len(triangles), dtype=np.intp),
    )


def _ground_colours(record: SiteRecord, window: Window) -> NDArray[np.float64]:
    """Return colours of grass, or of bare soil where it is cut or loose, (height, width, 3)."""
    rng = np.random.default_rng(NOISE_SEED)
    loose = window.crop(record.loose_depth) > LOOSE_M
    cut = window.crop(record.change) < -CUT_M
    patches = PATCHES * _smooth(rng.random(loose.shape), max(1, round(0.8 / record.grid.cell)))
    colours = (1 - patches[..., None]) * np.array(GRASS) + patches[..., None] * np.array(DRY_GRASS)
    colours[cut] = BANK
    colours[loose] = LOOSE
    grain = rng.normal(1.0, GRAIN, (*loose.shape, 1))
    return np.asarray(np.clip(colours * grain, 0.0, 1.0), dtype=np.float64)


def _smooth(image: NDArray[np.float64], radius: int) -> NDArray[np.float64]:
    """Return the running mean over a square, applied twice, scaled to 0..1."""
    kernel = np.ones(2 * radius + 1) / (2 * radius + 1)
    for axis in (0, 1, 0, 1):
        padded = np.pad(
            image, [(radius, radius) if a == axis else (0, 0) for a in (0, 1)], "reflect"
        )
        image = np.apply_along_axis(np.convolve, axis, padded, kernel, "valid")
    return np.asarray((image - image.min()) / max(float(np.ptp(image)), 1e-12), dtype=np.float64)
