"""Columns of the particle state: their data types, the table in which kernels get them, and rows
that are removed from it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import literal_unroll
from numpy.typing import NDArray

from machine_sim.dem.compaction import move_rows
from msg_bridge.kernels import fixed_signature_kernel, helper

__all__ = ["COLUMN_TYPES", "ParticleColumns", "allocate_columns", "remove_rows", "view_rows"]

COLUMN_TYPES: dict[str, tuple[str, tuple[int, ...]]] = {
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
        for name, (dtype, shape) in COLUMN_TYPES.items()
    }


@fixed_signature_kernel
def view_rows(count, boxed_columns, boxed_view):  # type: ignore[no-untyped-def]
    """Make a boxed table that of the first rows of columns with spare capacity.

    Args:
        count: number of rows.
        boxed_columns: `ParticleColumns`, boxed.
        boxed_view: out, the same.
    """
    boxed_view.table = _first_rows(count, boxed_columns.table)


@helper(allocates=True)
def _first_rows(count, columns):  # type: ignore[no-untyped-def]
    """Return the first rows of a `ParticleColumns`."""
    c = columns
    return ParticleColumns(
        c.position[:count], c.velocity[:count], c.angular_velocity[:count], c.radius[:count],
        c.contact_radius[:count], c.mass[:count], c.inverse_mass[:count], c.volume_mm3[:count],
        c.soil[:count], c.moisture[:count], c.particle_id[:count], c.friction[:count],
        c.rolling_friction[:count], c.cohesion[:count], c.tool_friction[:count],
        c.tool_rolling_friction[:count], c.adhesion[:count], c.frozen[:count],
        c.penetration_limited[:count], c.settle_timer[:count], c.ground_spring[:count],
        c.ground_overlap[:count], c.sleep_state[:count], c.wake_reference[:count],
        c.sleep_timer[:count], c.pair_list_row[:count], c.plate_list_row[:count],
    )  # fmt: skip


@fixed_signature_kernel
def remove_rows(removed, count, boxed_columns, boxed_view, order, kept):  # type: ignore[no-untyped-def]
    """Remove rows; the others keep their order.

    Args:
        removed: the rows.
        count: previous number of rows.
        boxed_columns: `ParticleColumns` with spare capacity, boxed; updated.
        boxed_view: out, the same, of the rows that are left.
        order: rows in the order of their ids, or none; those that are left come first.
        kept: out, previous numbers of the rows that are left, ascending, with room for all.

    Returns:
        Number of rows that are left.
    """
    new_row, num_kept = np.zeros(count, np.int64), 0
    for i in removed:
        new_row[i] = -1
    for i in range(count):
        if new_row[i] == 0:
            new_row[i] = num_kept
            kept[num_kept] = i
            num_kept += 1
    num_ordered = 0
    for i in order:
        if new_row[i] >= 0:
            order[num_ordered] = new_row[i]
            num_ordered += 1
    _move_rows_down(kept[:num_kept], boxed_columns.table)
    boxed_view.table = _first_rows(num_kept, boxed_columns.table)
    return num_kept


@helper(allocates=True)
def _move_rows_down(kept, columns):  # type: ignore[no-untyped-def]
    """Make row `kept[k]` row k of every column, in place; `kept` is ascending.

    Rows that were adjacent are moved together: few are removed at a time.
    """
    c, starts = columns, _starts_of_runs(kept)
    for column in literal_unroll((
        c.position, c.velocity, c.angular_velocity, c.radius, c.contact_radius, c.mass,
        c.inverse_mass, c.volume_mm3, c.soil, c.moisture, c.particle_id, c.friction,
        c.rolling_friction, c.cohesion, c.tool_friction, c.tool_rolling_friction, c.adhesion,
        c.frozen, c.penetration_limited, c.settle_timer, c.ground_spring, c.ground_overlap,
        c.sleep_state, c.wake_reference, c.sleep_timer, c.pair_list_row, c.plate_list_row,
    )):  # fmt: skip
        for n in range(starts.size - 1):
            k = starts[n]
            move_rows(column, kept[k], k, starts[n + 1] - k)


@helper(allocates=True)
def _starts_of_runs(kept):  # type: ignore[no-untyped-def]
    """Return the first number of each run of consecutive rows that moves down, and the end."""
    starts, count = np.empty(kept.size + 1, np.int64), 0
    for k in range(kept.size):
        starts[count] = k
        count += kept[k] > k and (k == 0 or kept[k] != kept[k - 1] + 1)
    starts[count] = kept.size
    return starts[: count + 1]
