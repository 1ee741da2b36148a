"""Sun, shadow and sky on what the pixels of a picture see."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from earthmoving_sim.pictures.mesh import Mesh
from earthmoving_sim.pictures.rasterizer import Camera, barycentric, rasterize

__all__ = ["render"]

SUPERSAMPLING = 2  # the picture is made this many times finer and averaged, against jagged edges
SUN_AZIMUTH_OFFSET = np.radians(65.0)  # azimuth of the sun, clockwise from the camera's
SUN_ELEVATION = np.radians(42.0)
SUN, SKY, GROUND_LIGHT = 0.82, 0.40, 0.20  # light from the sun, from above, and from the ground
SUN_TINT, SKY_TINT = np.array([1.06, 1.0, 0.9]), np.array([0.92, 0.99, 1.12])
SHADOW_PX = 1400  # width of the picture that the sun sees
SHADOW_BIAS_PX = 2.0  # points are lifted off their surface by this, or it would shade itself
SHADOW_OFFSETS_PX = (
    -1.5,
    0.0,
    1.5,
)  # places beside a point whose shadows are averaged: a soft edge
EDGE_SHADE = 0.55  # brightness of lines between the machine's faces
MAX_PIXELS_PER_BATCH = 2**18

# Brightness noise on the ground; one seed, so the same record gives the same picture.
GRAIN_M = 0.06  # size of a grain [m]
GRAIN = np.random.default_rng(7).normal(0.0, 0.12, (64, 64, 64))


def render(
    mesh: Mesh, camera: Camera, origin: NDArray[np.float64], scale: float, shape: tuple[int, int]
) -> NDArray[np.float64]:
    """A picture of a mesh, red, green, blue and opacity from 0 to 1, shape [height, width, 4].

    Args:
        mesh: what to draw.
        camera: the direction it is seen from.
        origin: right and up of the lower left corner in the camera's view [m], shape [2].
        scale: pixels a metre.
        shape: height and width [px]; row 0 is the lowest.
    """
    fine = SUPERSAMPLING * scale
    view = camera.view(mesh.points)
    view = np.concatenate([(view[:, :2] - origin) * fine - 0.5, view[:, 2:] * fine], axis=1)
    fine_shape = (SUPERSAMPLING * shape[0], SUPERSAMPLING * shape[1])
    faces, _ = rasterize(view, mesh.triangles, fine_shape)
    sun = Camera(camera.azimuth - SUN_AZIMUTH_OFFSET, SUN_ELEVATION)
    shadow = ShadowMap(mesh, sun)
    picture = np.zeros((faces.size, 4), dtype=np.float32)
    seen = np.flatnonzero(faces.ravel() >= 0)
    for some in np.array_split(seen, 1 + seen.size // MAX_PIXELS_PER_BATCH):
        face = faces.ravel()[some]
        row, column = np.divmod(some, fine_shape[1])
        weights = barycentric(view[mesh.triangles[face]], column, row)
        picture[some, :3] = _shade(mesh, face, weights, camera, sun, shadow)
        picture[some, 3] = 1.0
    image = picture.reshape(*fine_shape, 4)
    image[_part_edges(np.where(faces >= 0, mesh.parts[faces], 0)), :3] *= EDGE_SHADE
    return _downsample(image)


def _shade(
    mesh: Mesh,
    face: NDArray[np.intp],
    weights: NDArray[np.float64],
    camera: Camera,
    sun: Camera,
    shadow: ShadowMap,
) -> NDArray[np.float64]:
    """Colours of points in triangles [k], given by shares of their corners [k, 3]."""
    triangles = mesh.triangles[face]
    normal = _interpolate(mesh.normals[triangles], weights)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= np.where(normal @ camera.toward < 0.0, -1.0, 1.0)[:, None]  # faces have two sides
    place = _interpolate(mesh.points[triangles], weights)
    facing = np.clip(normal @ sun.toward, 0.0, None) * shadow.sunlit_fraction(place, normal)
    sky = 0.5 + 0.5 * normal[:, 2]
    light = SUN * facing[:, None] * SUN_TINT + SKY * sky[:, None] * SKY_TINT
    colours = _interpolate(mesh.colours[triangles], weights)
    ground = mesh.parts[face] == 0
    colours[ground] *= _brightness_noise(place[ground])[:, None]
    return np.asarray(np.clip(colours * (light + GROUND_LIGHT), 0.0, 1.0), dtype=np.float64)


def _interpolate(corners: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """What lies between corners [k, 3, 3] by their shares [k, 3], shape [k, 3]."""
    return np.asarray(np.einsum("kci,kc->ki", corners, weights), dtype=np.float64)


class ShadowMap:
    """What the sun sees, and so what lies in shadow."""

    def __init__(self, mesh: Mesh, sun: Camera) -> None:
        view = sun.view(mesh.points)
        self._sun = sun
        self._origin = view.min(axis=0)
        size = np.ptp(view, axis=0)
        self._scale = SHADOW_PX / float(max(size[0], size[1]))
        shape = np.ceil(size[1::-1] * self._scale).astype(int) + 1
        pixels = (view - self._origin) * self._scale
        _, self._depths = rasterize(pixels, mesh.triangles, (int(shape[0]), int(shape[1])))

    def sunlit_fraction(
        self, points: NDArray[np.float64], normal: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Share of the sun, 0 to 1, shape [n], at points [m] with unit normals, shape [n, 3]."""
        points = points + normal * (SHADOW_BIAS_PX / self._scale)
        pixels = (self._sun.view(points) - self._origin) * self._scale
        depth = pixels[:, 2] - SHADOW_BIAS_PX
        height, width = self._depths.shape
        sunlit_fraction = np.zeros(len(points))
        for up in SHADOW_OFFSETS_PX:
            row = np.rint(pixels[:, 1] + up).astype(np.int64).clip(0, height - 1)
            for right in SHADOW_OFFSETS_PX:
                column = np.rint(pixels[:, 0] + right).astype(np.int64).clip(0, width - 1)
                sunlit_fraction += depth <= self._depths[row, column]
        return np.asarray(sunlit_fraction / len(SHADOW_OFFSETS_PX) ** 2, dtype=np.float64)


def _brightness_noise(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Fine brightness noise about 1 fixed to places on the ground [m], shape [n, 3] to [n]."""
    place = points / GRAIN_M
    corner = np.floor(place).astype(np.int64)
    beyond = place - corner
    noise = np.zeros(len(points))
    for step in product((0, 1), repeat=3):
        share = np.where(step, beyond, 1.0 - beyond)
        i, j, k = ((corner + step) % len(GRAIN)).T
        noise += share[:, 0] * share[:, 1] * share[:, 2] * GRAIN[i, j, k]
    return 1.0 + noise


def _part_edges(parts: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Pixels where a face of the machine meets something else, two pixels wide."""
    edge = np.zeros(parts.shape, dtype=np.bool_)
    across, down = parts[:, 1:] != parts[:, :-1], parts[1:] != parts[:-1]
    edge[:, 1:] |= across
    edge[:, :-1] |= across
    edge[1:] |= down
    edge[:-1] |= down
    return edge


def _downsample(image: NDArray[np.float32]) -> NDArray[np.float64]:
    """An image at its final size, with straight alpha: colours of covered pixels only."""
    height, width = image.shape[0] // SUPERSAMPLING, image.shape[1] // SUPERSAMPLING
    mean = (
        image.reshape(height, SUPERSAMPLING, width, SUPERSAMPLING, 4)
        .mean(axis=(1, 3))
        .astype(np.float64)
    )
    mean[..., :3] /= np.maximum(mean[..., 3:], 1e-6)
    return np.asarray(np.clip(mean, 0.0, 1.0), dtype=np.float64)
