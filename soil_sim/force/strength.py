"""Strength of the kinds of soil as tables, and wrenches that add up: what force kernels share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from soil_sim.jit import helper
from soil_sim.soils import MOIST, SoilType
from soil_sim.vectors import cross, over

__all__ = ["Strength", "add_force", "column_at", "total_wrench"]

_GRAVITY = 9.81


class Strength(NamedTuple):
    """What kernels need of the kinds of soil, by id, and by id and moisture [%].

    Attributes:
        gamma: unit weight of firm soil [N/m³], shape (kinds,).
        phi, delta: internal and tool friction [rad], shape (kinds,).
        tensile: of rock [Pa], 0 for soil, shape (kinds,).
        n_c, n_q, n_gamma: factors of bearing capacity [-], shape (kinds,).
        cohesion, adhesion: [Pa], shape (kinds, MOIST).
    """

    gamma: NDArray[np.float64]
    phi: NDArray[np.float64]
    delta: NDArray[np.float64]
    tensile: NDArray[np.float64]
    n_c: NDArray[np.float64]
    n_q: NDArray[np.float64]
    n_gamma: NDArray[np.float64]
    cohesion: NDArray[np.float64]
    adhesion: NDArray[np.float64]

    @classmethod
    def of(cls, kinds: Sequence[SoilType]) -> Strength:
        """Tables of some kinds of soil, whose ids are their places in the sequence."""
        stick = np.array([[kind.stick(m) for m in range(MOIST)] for kind in kinds])
        phi = np.array([math.radians(kind.internal_friction) for kind in kinds])
        tan = np.tan(np.maximum(phi, 1e-6))  # without friction N_c tends to 2 + pi
        n_q = np.exp(math.pi * tan) * np.tan(math.pi / 4 + np.arctan(tan) / 2) ** 2
        return cls(
            np.array([kind.density * _GRAVITY for kind in kinds]),
            phi,
            np.array([math.radians(kind.tool_friction) for kind in kinds]),
            np.array([kind.tensile_strength for kind in kinds]),
            (n_q - 1.0) / tan,
            n_q,
            2.0 * (n_q + 1.0) * tan,
            np.array([[kind.cohesion] for kind in kinds]) * stick,
            np.array([[kind.adhesion] for kind in kinds]) * stick,
        )


@helper()
def add_force(sums, at, force):  # type: ignore[no-untyped-def]
    """Add a force [N] at a place [m] to force, torque, place by strength, strength, shape (10,)."""
    x, y, z = at
    fx, fy, fz = force
    size = math.sqrt(fx * fx + fy * fy + fz * fz)
    sums[0] += fx
    sums[1] += fy
    sums[2] += fz
    sums[3] += y * fz - z * fy
    sums[4] += z * fx - x * fz
    sums[5] += x * fy - y * fx
    sums[6] += size * x
    sums[7] += size * y
    sums[8] += size * z
    sums[9] += size


@helper()
def total_wrench(sums, origin, out):  # type: ignore[no-untyped-def]
    """Point [m], force [N] and torque about the point [N m] of what `add_force` added up, into out.

    The point is the mean of where the forces act, by their strength; places count from `origin`.
    """
    for axis in range(3):
        out[axis] = origin[axis]
    if sums[9] > 0.0:
        at = over((sums[6], sums[7], sums[8]), sums[9])
        moved = cross(at, (sums[0], sums[1], sums[2]))
        for axis in range(3):
            out[axis] += at[axis]
            out[3 + axis] = sums[axis]
            out[6 + axis] = sums[3 + axis] - moved[axis]


@helper()
def column_at(x, y, frame):  # type: ignore[no-untyped-def]
    """Flat index of the column at a place [m]; -1 beyond the map."""
    rows, cols, cell, x_first, y_first = frame
    row = int(math.floor((x_first - x) / cell + 0.5))
    col = int(math.floor((y_first - y) / cell + 0.5))
    if 0 <= row < rows and 0 <= col < cols:
        return row * cols + col
    return -1
