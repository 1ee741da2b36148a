"""Sunlight, shadow and sky light of the visible triangles of a mesh."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from earthmoving_sim.coloured_mesh import ColouredMesh
from earthmoving_sim.pictures.rasterizer import Camera, barycentric, rasterize

__all__ = ["render"]

SUPERSAMPLING = 2  # pixels rendered per pixel and axis, averaged against jagged edges
SUN_AZIMUTH_OFFSET = np.radians(65.0)  # azimuth of the sun, clockwise from the camera's
SUN_ELEVATION = np.radians(42.0)
SUN, SKY, GROUND_LIGHT = 0.82, 0.40, 0.20  # light from the sun, from above, and from the ground
SUN_TINT, SKY_TINT = np.array([1.06, 1.0, 0.9]), np.array([0.92, 0.99, 1.12])
SHADOW_PX = 1400  # longest side of the shadow map [px]
SHADOW_BIAS_PX = 2.0  # offset of points from their surface, so that it does not shade itself
SHADOW_OFFSETS_PX = (-1.5, 0.0, 1.5)  # offsets over which shadows are averaged: a soft edge
EDGE_SHADE = 0.55  # brightness of lines between the machine's parts
MAX_PIXELS_PER_BATCH = 2**18

# Brightness noise on the ground; a fixed seed, so the same record gives the same picture.
GRAIN_M = 0.06  # size of a grain [m]
GRAIN = np.random.default_rng(7).normal(0.0, 0.12, (64, 64, 64))


def render(
    mesh: ColouredMesh,
    camera: Camera,
    origin: NDArray[np.float64],
    scale: float,
    shape: tuple[int, int],
) -> NDArray[np.float64]:
    """Return a picture of a mesh: red, green, blue and opacity from 0 to 1, (height, width, 4).

    Args:
        mesh: the mesh.
        camera: direction of view.
        origin: right and up of the lower left corner in the camera's view [m], shape (2,).
        scale: pixels per metre.
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
    covered = np.flatnonzero(faces.ravel() >= 0)
    for batch in np.array_split(covered, 1 + covered.size // MAX_PIXELS_PER_BATCH):
        face = faces.ravel()[batch]
        row, column = np.divmod(batch, fine_shape[1])
        weights = barycentric(view[mesh.triangles[face]], column, row)
        picture[batch, :3] = _shade(mesh, face, weights, camera, sun, shadow)
        picture[batch, 3] = 1.0
    image = picture.reshape(*fine_shape, 4)
    image[_part_edges(np.where(faces >= 0, mesh.parts[faces], 0)), :3] *= EDGE_SHADE
    return _downsample(image)


def _shade(
    mesh: ColouredMesh,
    face: NDArray[np.intp],
    weights: NDArray[np.float64],
    camera: Camera,
    sun: Camera,
    shadow: ShadowMap,
) -> NDArray[np.float64]:
    """Return the colours of points in triangles (k,), given by barycentric weights (k, 3)."""
    triangles = mesh.triangles[face]
    normal = _interpolate(mesh.normals[triangles], weights)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= np.where(normal @ camera.toward < 0.0, -1.0, 1.0)[:, None]  # faces have two sides
    position = _interpolate(mesh.points[triangles], weights)
    facing = np.clip(normal @ sun.toward, 0.0, None) * shadow.sunlit_fraction(position, normal)
    sky = 0.5 + 0.5 * normal[:, 2]
    light = SUN * facing[:, None] * SUN_TINT + SKY * sky[:, None] * SKY_TINT
    colours = _interpolate(mesh.colours[triangles], weights)
    ground = mesh.parts[face] == 0
    colours[ground] *= _brightness_noise(position[ground])[:, None]
    return np.asarray(np.clip(colours * (light + GROUND_LIGHT), 0.0, 1.0), dtype=np.float64)


def _interpolate(corners: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return values at corners (k, 3, 3) interpolated with weights (k, 3), shape (k, 3)."""
    return np.asarray(np.einsum("kci,kc->ki", corners, weights), dtype=np.float64)


class ShadowMap:
    """Depths of a mesh seen from the sun, which give its shadows."""

    def __init__(self, mesh: ColouredMesh, sun: Camera) -> None:
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
        """Return the sunlit fraction (n,), 0 to 1, at points [m] with unit normals, (n, 3) each."""
        points = points + normal * (SHADOW_BIAS_PX / self._scale)
        pixels = (self._sun.view(points) - self._origin) * self._scale
        depth = pixels[:, 2] - SHADOW_BIAS_PX
        height, width = self._depths.shape
        num_sunlit = np.zeros(len(points))
        for up in SHADOW_OFFSETS_PX:
            row = np.rint(pixels[:, 1] + up).astype(np.int64).clip(0, height - 1)
            for right in SHADOW_OFFSETS_PX:
                column = np.rint(pixels[:, 0] + right).astype(np.int64).clip(0, width - 1)
                num_sunlit += depth <= self._depths[row, column]
        return np.asarray(num_sunlit / len(SHADOW_OFFSETS_PX) ** 2, dtype=np.float64)


def _brightness_noise(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return brightness noise about 1, shape (n,), that is fixed to positions [m], shape (n, 3)."""
    scaled = points / GRAIN_M
    corner = np.floor(scaled).astype(np.int64)
    fraction = scaled - corner
    noise = np.zeros(len(points))
    for step in product((0, 1), repeat=3):
        weight = np.where(step, fraction, 1.0 - fraction)
        i, j, k = ((corner + step) % len(GRAIN)).T
        noise += weight[:, 0] * weight[:, 1] * weight[:, 2] * GRAIN[i, j, k]
    return 1.0 + noise


def _part_edges(parts: NDArray[np.intp]) -> NDArray[np.bool_]:
    """Return the edges of the machine's parts, two pixels wide, as a mask."""
    edge = np.zeros(parts.shape, dtype=np.bool_)
    across, down = parts[:, 1:] != parts[:, :-1], parts[1:] != parts[:-1]
    edge[:, 1:] |= across
    edge[:, :-1] |= across
    edge[1:] |= down
    edge[:-1] |= down
    return edge


def _downsample(image: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return an image at its final size; colours are averaged over covered pixels only."""
    height, width = image.shape[0] // SUPERSAMPLING, image.shape[1] // SUPERSAMPLING
    mean = (
        image.reshape(height, SUPERSAMPLING, width, SUPERSAMPLING, 4)
        .mean(axis=(1, 3))
        .astype(np.float64)
    )
    mean[..., :3] /= np.maximum(mean[..., 3:], 1e-6)
    return np.asarray(np.clip(mean, 0.0, 1.0), dtype=np.float64)
