"""Visible triangle of a mesh at each pixel: a z-buffer in numpy.

Hidden surfaces are removed pixel by pixel, so ground and machine may intersect; sorting faces by
distance, as matplotlib's 3-D axes do, cannot show that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Camera", "barycentric", "rasterize"]

NOTHING = np.iinfo(np.int64).max
DEPTH_STEPS = 2**30  # depths as integers, so that depth and face make one key
FACE_BITS = 32
MAX_SAMPLES_PER_BATCH = 2**21  # bounds memory: about 100 bytes a sample


@dataclass(frozen=True)
class Camera:
    """An orthographic camera: all lengths have the same scale.

    Attributes:
        azimuth: direction toward the camera, from +x toward +y [rad].
        elevation: direction toward the camera above the horizon [rad].
    """

    azimuth: float
    elevation: float

    @property
    def toward(self) -> NDArray[np.float64]:
        """Unit vector toward the camera, map frame, shape (3,)."""
        flat = np.cos(self.elevation)
        return np.array(
            [
                flat * np.cos(self.azimuth),
                flat * np.sin(self.azimuth),
                np.sin(self.elevation),
            ]
        )

    def view(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points [m] (n, 3) as right, up and depth in the picture [m], shape (n, 3)."""
        right = np.array([-np.sin(self.azimuth), np.cos(self.azimuth), 0.0])
        up = np.cross(self.toward, right)
        return np.asarray(points @ np.stack([right, up, -self.toward], axis=1), dtype=np.float64)


def rasterize(
    points: NDArray[np.float64], triangles: NDArray[np.intp], shape: tuple[int, int]
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return the nearest triangle at the centre of each pixel.

    Args:
        points: column, row and depth of each point, in pixels, shape (n, 3); the centre of the
            first pixel is (0, 0).
        triangles: indices of the points of each triangle, shape (m, 3).
        shape: height and width of the picture [px].

    Returns:
        Index of the triangle, -1 where there is none, and its depth, inf where there is none; both
        of the given shape.
    """
    height, width = shape
    keys = np.full(height * width, NOTHING, dtype=np.int64)
    nearest, farthest = float(points[:, 2].min()), float(points[:, 2].max())
    step = max(farthest - nearest, 1e-9) / DEPTH_STEPS
    corners = points[triangles]
    low = np.ceil(corners[..., :2].min(axis=1)).astype(np.int64).clip(0)
    high = np.floor(corners[..., :2].max(axis=1)).astype(np.int64)
    high = np.minimum(high, [width - 1, height - 1])
    extent = high - low + 1
    drawn = np.flatnonzero((extent > 0).all(axis=1) & (_twice_area(corners) != 0.0))
    # Triangles with bounding boxes of similar size are drawn together, in boxes of 2^a x 2^b.
    boxes = np.ceil(np.log2(extent[drawn])).astype(np.int64)
    for box in np.unique(boxes, axis=0):
        box_width, box_height = (2**box).tolist()
        columns, rows = np.meshgrid(np.arange(box_width), np.arange(box_height))
        members = drawn[(boxes == box).all(axis=1)]
        for batch in np.array_split(
            members, 1 + members.size * box_width * box_height // MAX_SAMPLES_PER_BATCH
        ):
            x = low[batch, 0, None] + columns.ravel()
            y = low[batch, 1, None] + rows.ravel()
            weights = barycentric(corners[batch, None], x, y)
            a, b, c = np.moveaxis(weights, -1, 0)
            is_inside = (a >= 0.0) & (b >= 0.0) & (c >= 0.0) & (x < width) & (y < height)
            depth_a, depth_b, depth_c = corners[batch, :, 2].T[..., None]
            depth = a * depth_a + b * depth_b + c * depth_c
            steps = ((depth - nearest) / step).clip(0, DEPTH_STEPS)
            key = (steps.astype(np.int64) << FACE_BITS) | batch[:, None]
            np.minimum.at(keys, (y * width + x)[is_inside], key[is_inside])
    empty = keys == NOTHING
    faces = np.where(empty, -1, keys & (2**FACE_BITS - 1))
    depths = np.where(empty, np.inf, nearest + (keys >> FACE_BITS) * step)
    return faces.reshape(shape), depths.reshape(shape)


def barycentric(
    corners: NDArray[np.float64], x: NDArray[np.integer], y: NDArray[np.integer]
) -> NDArray[np.float64]:
    """Return barycentric weights (..., 3) of triangles (..., 3, 2 or more) at pixels x, y (...)."""
    a, b, c = corners[..., 0, :], corners[..., 1, :], corners[..., 2, :]
    area = _twice_area(corners)
    weight_a = ((b[..., 0] - x) * (c[..., 1] - y) - (c[..., 0] - x) * (b[..., 1] - y)) / area
    weight_b = ((c[..., 0] - x) * (a[..., 1] - y) - (a[..., 0] - x) * (c[..., 1] - y)) / area
    return np.stack([weight_a, weight_b, 1.0 - weight_a - weight_b], axis=-1)


def _twice_area(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return twice the signed area of triangles in the picture [px^2], shape (...)."""
    a, b, c = corners[..., 0, :], corners[..., 1, :], corners[..., 2, :]
    return np.asarray(
        (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1])
        - (c[..., 0] - a[..., 0]) * (b[..., 1] - a[..., 1]),
        dtype=np.float64,
    )
