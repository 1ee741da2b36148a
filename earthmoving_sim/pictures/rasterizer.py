"""Which triangle of a mesh each pixel sees: a z-buffer in numpy.

It finds hidden surfaces pixel by pixel, so ground and machine may reach into one another; sorting
whole faces by distance, as matplotlib's 3-D axes do, cannot show that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Camera", "barycentric", "rasterize"]

NOTHING = np.iinfo(np.int64).max
DEPTH_STEPS = 2**30  # depths are compared as integers, so that they can share a key with a face
FACE_BITS = 32
MAX_SAMPLES_PER_BATCH = 2**21  # bounds memory: about 100 bytes a sample


@dataclass(frozen=True)
class Camera:
    """An orthographic view toward a point, from a direction: all lengths keep their scale.

    Attributes:
        azimuth: direction of the camera seen from the point, from +x toward +y [rad].
        elevation: its height above the horizon [rad].
    """

    azimuth: float
    elevation: float

    @property
    def toward(self) -> NDArray[np.float64]:
        """Unit vector to the camera, map frame, shape [3]."""
        flat = np.cos(self.elevation)
        return np.array(
            [
                flat * np.cos(self.azimuth),
                flat * np.sin(self.azimuth),
                np.sin(self.elevation),
            ]
        )

    def view(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points [m], shape [n, 3], as right, up and distance away in the picture [m]."""
        right = np.array([-np.sin(self.azimuth), np.cos(self.azimuth), 0.0])
        up = np.cross(self.toward, right)
        return np.asarray(points @ np.stack([right, up, -self.toward], axis=1), dtype=np.float64)


def rasterize(
    points: NDArray[np.float64], triangles: NDArray[np.intp], shape: tuple[int, int]
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """The nearest triangle at each pixel's centre.

    Args:
        points: column, row and distance of each point, in pixels, shape [n, 3]; the centre of the
            first pixel is (0, 0).
        triangles: the three points of each triangle, shape [m, 3].
        shape: height and width of the picture [px].

    Returns:
        Index of the triangle, -1 where there is none, and its distance, inf where there is none;
        both of the given shape.
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
    # Triangles whose bounding boxes have about one size are drawn together, in boxes of 2^a x 2^b.
    boxes = np.ceil(np.log2(extent[drawn])).astype(np.int64)
    for box in np.unique(boxes, axis=0):
        wide, tall = (2**box).tolist()
        across, down = np.meshgrid(np.arange(wide), np.arange(tall))
        members = drawn[(boxes == box).all(axis=1)]
        for some in np.array_split(
            members, 1 + members.size * wide * tall // MAX_SAMPLES_PER_BATCH
        ):
            x = low[some, 0, None] + across.ravel()
            y = low[some, 1, None] + down.ravel()
            weights = barycentric(corners[some, None], x, y)
            a, b, c = np.moveaxis(weights, -1, 0)
            hit = (a >= 0.0) & (b >= 0.0) & (c >= 0.0) & (x < width) & (y < height)
            of_a, of_b, of_c = corners[some, :, 2].T[..., None]
            depth = a * of_a + b * of_b + c * of_c
            steps = ((depth - nearest) / step).clip(0, DEPTH_STEPS)
            key = (steps.astype(np.int64) << FACE_BITS) | some[:, None]
            np.minimum.at(keys, (y * width + x)[hit], key[hit])
    empty = keys == NOTHING
    faces = np.where(empty, -1, keys & (2**FACE_BITS - 1))
    depths = np.where(empty, np.inf, nearest + (keys >> FACE_BITS) * step)
    return faces.reshape(shape), depths.reshape(shape)


def barycentric(
    corners: NDArray[np.float64], x: NDArray[np.integer], y: NDArray[np.integer]
) -> NDArray[np.float64]:
    """Shares of a triangle's corners [..., 3, 2 or more] at pixels x, y [...], shape [..., 3]."""
    a, b, c = corners[..., 0, :], corners[..., 1, :], corners[..., 2, :]
    area = _twice_area(corners)
    of_a = ((b[..., 0] - x) * (c[..., 1] - y) - (c[..., 0] - x) * (b[..., 1] - y)) / area
    of_b = ((c[..., 0] - x) * (a[..., 1] - y) - (a[..., 0] - x) * (c[..., 1] - y)) / area
    return np.stack([of_a, of_b, 1.0 - of_a - of_b], axis=-1)


def _twice_area(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Twice the signed area of triangles in the picture [px^2], shape [...]."""
    a, b, c = corners[..., 0, :], corners[..., 1, :], corners[..., 2, :]
    return np.asarray(
        (b[..., 0] - a[..., 0]) * (c[..., 1] - a[..., 1])
        - (c[..., 0] - a[..., 0]) * (b[..., 1] - a[..., 1]),
        dtype=np.float64,
    )
