"""Strength of the kinds of soil as tables, and wrenches that add up: what force kernels share."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.constants import GRAVITY, MOISTURE_LEVELS
from msg_bridge.kernels import helper
from soil_sim.columns.state import ColumnArrays
from soil_sim.soils.soil_types import SoilType
from soil_sim.vec3 import cross, divide

__all__ = [
    "STRENGTH_DTYPE",
    "ForceColumns",
    "add_force",
    "column_index_at",
    "reduce_wrench",
    "strength_table",
]


class ForceColumns(NamedTuple):
    """What force kernels need of the terrain, as in `ColumnArrays`.

    No more of it, as each array that is handed on makes a kernel take longer to compile.
    """

    loose: NDArray[np.int64]
    bulk: NDArray[np.int64]
    height: NDArray[np.float64]
    soil: NDArray[np.uint8]
    loose_soil: NDArray[np.uint8]
    moisture: NDArray[np.uint8]
    metres_per_mm3: float

    @classmethod
    def from_columns(cls, columns: ColumnArrays) -> ForceColumns:
        """That of a terrain, whose arrays it shares."""
        return cls(*(getattr(columns, name) for name in cls._fields))


STRENGTH_DTYPE = np.dtype(
    [
        ("gamma", np.float64),  # unit weight of firm soil [N/m³]
        ("phi", np.float64),  # internal friction [rad]
        ("delta", np.float64),  # tool friction [rad]
        ("tensile_strength", np.float64),  # of rock [Pa], 0 for soil
        ("n_c", np.float64),  # factors of bearing capacity [-]
        ("n_q", np.float64),
        ("n_gamma", np.float64),
        ("cohesion", np.float64, (MOISTURE_LEVELS,)),  # [Pa], by moisture [%]
        ("adhesion", np.float64, (MOISTURE_LEVELS,)),
    ]
)
"""What kernels need of a kind of soil."""


def strength_table(kinds: Sequence[SoilType]) -> NDArray[np.void]:
    """Rows of `STRENGTH_DTYPE` for some kinds of soil, whose ids are their places in the sequence."""
    stick = np.array(
        [[kind.moisture_strength_factor(m) for m in range(MOISTURE_LEVELS)] for kind in kinds]
    )
    phi = np.array([math.radians(kind.internal_friction) for kind in kinds])
    tan = np.tan(np.maximum(phi, 1e-6))  # without friction N_c tends to 2 + pi
    n_q = np.exp(math.pi * tan) * np.tan(math.pi / 4 + np.arctan(tan) / 2) ** 2
    rows = np.zeros(len(kinds), STRENGTH_DTYPE)
    rows["gamma"] = [kind.density * GRAVITY for kind in kinds]
    rows["phi"] = phi
    rows["delta"] = [math.radians(kind.tool_friction) for kind in kinds]
    rows["tensile_strength"] = [kind.tensile_strength for kind in kinds]
    rows["n_c"], rows["n_q"], rows["n_gamma"] = (n_q - 1.0) / tan, n_q, 2.0 * (n_q + 1.0) * tan
    rows["cohesion"] = np.array([[kind.cohesion] for kind in kinds]) * stick
    rows["adhesion"] = np.array([[kind.adhesion] for kind in kinds]) * stick
    return rows


@helper
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


@helper
def reduce_wrench(sums, origin, out):  # type: ignore[no-untyped-def]
    """Point [m], force [N] and torque about the point [N m] of what `add_force` added up, into out.

    The point is the mean of where the forces act, by their strength; places count from `origin`.
    """
    for axis in range(3):
        out[axis] = origin[axis]
    if sums[9] > 0.0:
        at = divide((sums[6], sums[7], sums[8]), sums[9])
        moved = cross(at, (sums[0], sums[1], sums[2]))
        for axis in range(3):
            out[axis] += at[axis]
            out[3 + axis] = sums[axis]
            out[6 + axis] = sums[3 + axis] - moved[axis]


@helper
def column_index_at(x, y, grid_layout):  # type: ignore[no-untyped-def]
    """Flat index of the column at a place [m]; -1 beyond the map."""
    rows, cols, cell, x_first, y_first = grid_layout
    row = int(math.floor((x_first - x) / cell + 0.5))
    col = int(math.floor((y_first - y) / cell + 0.5))
    if 0 <= row < rows and 0 <= col < cols:
        return row * cols + col
    return -1
