"""Columns of the particle state: their data types, and the table in which kernels get them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["ParticleColumns", "allocate_columns"]

_COLUMN_TYPES: dict[str, tuple[str, tuple[int, ...]]] = {
    "position": ("f8", (3,)),
    "velocity": ("f8", (3,)),
    "angular_velocity": ("f4", (3,)),
    "radius": ("f4", ()),
    "contact_radius": ("f4", ()),
    "mass": ("f4", ()),
    "inverse_mass": ("f4", ()),
    "volume_mm3": ("i8", ()),
    "soil": ("u1", ()),
    "moisture": ("u1", ()),
    "particle_id": ("u4", ()),
    "friction": ("f4", ()),
    "rolling_friction": ("f4", ()),
    "cohesion": ("f4", ()),
    "tool_friction": ("f4", ()),
    "tool_rolling_friction": ("f4", ()),
    "adhesion": ("f4", ()),
    "frozen": ("?", ()),
    "penetration_limited": ("?", ()),
    "settle_timer": ("f4", ()),
    "ground_spring": ("f4", (3,)),
    "ground_overlap": ("f4", ()),
    "sleep_state": ("i2", ()),
    "wake_reference": ("f8", (3,)),
    "sleep_timer": ("f4", ()),
    "pair_list_row": ("i4", ()),
    "plate_list_row": ("i4", ()),
}
"""Data type and shape of one row of each column."""


class ParticleColumns(NamedTuple):
    """Columns of `ParticleState`; see there for the units.

    One table for all kernels: it is boxed once after rows were added or removed.
    """

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    angular_velocity: NDArray[np.float32]
    radius: NDArray[np.float32]
    contact_radius: NDArray[np.float32]
    mass: NDArray[np.float32]
    inverse_mass: NDArray[np.float32]
    volume_mm3: NDArray[np.int64]
    soil: NDArray[np.uint8]
    moisture: NDArray[np.uint8]
    particle_id: NDArray[np.uint32]
    friction: NDArray[np.float32]
    rolling_friction: NDArray[np.float32]
    cohesion: NDArray[np.float32]
    tool_friction: NDArray[np.float32]
    tool_rolling_friction: NDArray[np.float32]
    adhesion: NDArray[np.float32]
    frozen: NDArray[np.bool_]
    penetration_limited: NDArray[np.bool_]
    settle_timer: NDArray[np.float32]
    ground_spring: NDArray[np.float32]
    ground_overlap: NDArray[np.float32]
    sleep_state: NDArray[np.int16]
    wake_reference: NDArray[np.float64]
    sleep_timer: NDArray[np.float32]
    pair_list_row: NDArray[np.int32]
    plate_list_row: NDArray[np.int32]


def allocate_columns(capacity: int) -> dict[str, NDArray[Any]]:
    """Return zeroed columns by name."""
    return {
        name: np.zeros((capacity, *shape), dtype=dtype)
        for name, (dtype, shape) in _COLUMN_TYPES.items()
    }
