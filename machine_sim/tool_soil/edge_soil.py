"""Soil at the cutting edge of a tool, which the tool will take in: from loose to bank volumes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from machine_sim.dem import Pose, SoilEngine
from msg_bridge.kernels import fixed_signature_kernel, helper

__all__ = ["bank_mm3", "swell_at_edge", "swell_at_point"]


def bank_mm3(loose_m3: float, swell: float) -> float:
    """Return the bank volume [mm^3] of a loose volume [m^3] of soil with a swell."""
    return 1e9 * loose_m3 / (1.0 + swell)


def swell_at_edge(key_points: NDArray[np.float64], particles: SoilEngine, pose: Pose) -> float:
    """Return the swell of the soil at the first key point of a tool, on its cutting edge.

    Args:
        key_points: [m], tool frame, shape (n, 3), n >= 1.
        particles: the particle engine, with the ground.
        pose: rotation tool to map, shape (3, 3), and origin [m], shape (3,).
    """
    ground = particles.ground
    swell: float = _swell_at_edge(
        key_points, *pose, ground.soil, ground.frame, float(ground.grid.cell), particles.swells
    )
    return swell


@fixed_signature_kernel
def _swell_at_edge(key_points, rotation, origin, soil, frame, cell, swells):  # type: ignore[no-untyped-def]
    """Run `swell_at_point` for the first of some key points."""
    return swell_at_point(key_points[0], rotation, origin, soil, frame, cell, swells)


@helper
def swell_at_point(point, rotation, origin, soil, frame, cell, swells):  # type: ignore[no-untyped-def]
    """Return the swell of the soil of the column nearest to a point of the frame of a tool.

    Args:
        point: [m], tool frame, shape (3,).
        rotation, origin: pose of the tool frame.
        soil, frame: of `Ground`.
        cell: size of a cell [m].
        swells: swell of each soil.
    """
    x, y, z = point[0], point[1], point[2]
    map_x = origin[0] + rotation[0, 0] * x + rotation[0, 1] * y + rotation[0, 2] * z
    map_y = origin[1] + rotation[1, 0] * x + rotation[1, 1] * y + rotation[1, 2] * z
    row = min(max(round((frame[0] - map_x) / cell), 0), soil.shape[0] - 1)
    col = min(max(round((frame[1] - map_y) / cell), 0), soil.shape[1] - 1)
    return swells[soil[row, col]]
