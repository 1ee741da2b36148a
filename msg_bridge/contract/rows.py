"""Rows exchanged between soil and machines, as NumPy structured arrays.

Every stream numbers its rows from 1 in `seq` (modulo 2**32): a gap is a lost row, a repeat is a
duplicate. Positions are in the map frame [m], volumes are of bank (undisturbed) soil [mm^3].
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from functools import cache

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "CONVERSION",
    "DEPOSIT_REQUEST",
    "ENDED_SESSION",
    "FORCE",
    "MAP_UPDATE",
    "MAX_MILLING_WORK",
    "MAX_PRESSURE",
    "MAX_ROW_VOLUME",
    "SWEEP",
    "SWEEP_SEGMENT",
    "UNLIMITED_ROOM",
    "ConversionKind",
    "Rows",
    "SoilReaction",
    "SweepAction",
    "are_of_machine",
    "copy_rows",
    "empty_rows",
    "has_kind",
    "join_rows",
    "machine_ids_in",
    "no_rows",
    "rows_of_machine",
]

Rows = NDArray[np.void]
"""A one-dimensional structured array of one of the dtypes below."""

ENDED_SESSION = 0
"""Machine id of conversion rows that release soil of ended sessions of machines that have joined
again: the present sessions never had that soil, so the rows are for no machine."""

MAX_ROW_VOLUME = 2**32 - 1
"""Largest volume of one row [mm^3]; larger volumes are split into several rows."""


UNLIMITED_ROOM = 2**32 - 1
"""`room_mm3` of a tool that holds no soil back, as a cutting drum, and of one with more room."""


class SweepAction(IntEnum):
    """Effect of a tool on the soil that it sweeps."""

    CUT = 0
    """Removes soil, as much as the tool has room for, and pushes the rest ahead: a cutting edge."""
    COMPACT = 1
    """Pushes soil down without removing it: a track shoe, the back of a bucket. Loose soil yields
    to bank density; firm soil yields to the pressure of the row, as far as that makes it sink."""
    MILL = 2
    """Removes soil on all sides by rotating picks, as far as the reported work suffices: a cutting
    drum that is driven. All of its pairs mill. Its key points form a closed curve, which does not
    rotate with the drum: the last pair repeats the first."""


class SoilReaction(IntEnum):
    """Cause of the force of a FORCE row."""

    CUT = 0
    """Resistance of the soil that the tool cuts."""
    BEARING = 1
    """Bearing capacity of the soil that the tool stands on."""
    MILL = 2
    """Soil that the picks of a drum engage."""


class ConversionKind(IntEnum):
    """Kind of a CONVERSION row."""

    EXCAVATE = 0
    """Soil was removed from a column and credited to the machine's pending account."""
    DEPOSIT = 1
    """The particle of a deposit request became terrain."""
    OUTSIDE = 2
    """The particle of a deposit request had left the map."""
    REJECT = 3
    """A deposit request was malformed; the particle remains a particle."""


SWEEP = np.dtype(
    [
        ("x0", "<f4"),  # key point at the start of the tick [m]
        ("y0", "<f4"),
        ("z0", "<f4"),
        ("x1", "<f4"),  # key point at the end of the tick [m]
        ("y1", "<f4"),
        ("z1", "<f4"),
        ("seq", "<u4"),
        ("room_mm3", "<u4"),  # bank volume that the tool can take in during the tick
        ("pair", "<u2"),  # rows 2k and 2k + 1 of a tool are the left and right end of pair k
        ("tool", "<u2"),
        ("machine_id", "<u2"),
        ("action", "u1"),  # SweepAction
        ("work", "<f4"),  # that a drum can deliver in the tick [J], the same in all of its rows
        ("pressure", "<f4"),  # on the ground at the key point [Pa]; 0 unless it compacts
    ]
)
"""Motion of one key point of a tool over a tick, machine to soil; the pair at the lip comes
first. All rows of a tool repeat its room and its work, which is 0 for tools that do not mill."""

MAX_MILLING_WORK = 1e6
"""Largest work that a drum can deliver in a tick [J]: 100 MW at ticks of 10 ms."""

MAX_PRESSURE = 1e8
"""Largest pressure on the ground [Pa]: steel on rock is below it."""

SWEEP_SEGMENT = np.dtype([("ends", "<f4", (6,)), ("rest", f"V{SWEEP.itemsize - 24}")])
"""Dtype for views of SWEEP rows: `ends` is x0, y0, z0, x1, y1, z1 as one array field [m]."""

DEPOSIT_REQUEST = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("volume_mm3", "<u4"),
        ("particle_id", "<u4"),
        ("seq", "<u4"),
        ("machine_id", "<u2"),
        ("soil", "u1"),
        ("moisture", "u1"),
    ]
)
"""A particle that came to rest, machine to soil. The machine keeps it, frozen, until the soil
answers with a CONVERSION row of the same `particle_id`."""

CONVERSION = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("seq", "<u4"),
        ("tick", "<u4"),
        ("row", "<u4"),
        ("col", "<u4"),
        ("particle_id", "<u4"),
        ("volume_mm3", "<u4"),
        ("machine_id", "<u2"),
        ("soil", "u1"),
        ("moisture", "u1"),  # % of saturation
        ("kind", "u1"),  # ConversionKind
    ]
)
"""Soil that was moved, soil to all. EXCAVATE: x, y, z is the centroid of the removed soil, and
`soil` and `moisture` are those of the removed soil. An answer to a deposit request repeats its soil
and moisture."""

MAP_UPDATE = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),  # elevation [m]
        ("loose_depth", "<f4"),  # depth of loose soil [m]
        ("volume_mm3", "<f8"),  # above the floor; exact: integers below 2**53
        ("row", "<u4"),
        ("col", "<u4"),
        ("revision", "<u4"),
        ("seq", "<u4"),
        ("soil", "u1"),  # id of the soil type at the surface
        ("moisture", "u1"),  # at the surface [% of saturation]
        ("rut_depth", "<f4"),  # by which the surface was pressed down [m]
    ]
)
"""Complete state of a column that changed in a tick, slope failure included, soil to all."""

FORCE = np.dtype(
    [
        ("x", "<f4"),  # point of application [m]
        ("y", "<f4"),
        ("z", "<f4"),
        ("fx", "<f4"),  # force of the soil on the tool [N]
        ("fy", "<f4"),
        ("fz", "<f4"),
        ("tx", "<f4"),  # torque about that point [N m]
        ("ty", "<f4"),
        ("tz", "<f4"),
        ("seq", "<u4"),
        ("tool", "<u2"),
        ("machine_id", "<u2"),
        ("reaction", "u1"),  # SoilReaction
        ("work", "<f4"),  # that milling took in the tick [J]; 0 for other reactions
    ]
)
"""Largest force of the soil on a tool that swept, soil to machine. A tool that cuts gets a row of
its resistance even if it is zero; rows of bearing capacity are sent only where there is any.

The row of a drum has the point at which its picks engage soil, and the force that this soil can
exert there, out of the face; `work` is the part of the reported work that removed soil. Soil that
this work did not suffice to remove is in a second row, of bearing capacity."""


def join_rows(parts: Sequence[Rows], dtype: np.dtype[np.void]) -> Rows:
    """Return the concatenation of rows of `dtype`; a single non-empty part is not copied.

    Raises:
        ValueError: there are several parts, and one is of another dtype.
    """
    not_empty = [rows for rows in parts if rows.size]
    if len(not_empty) > 1:
        return _from_bytes(b"".join([_to_bytes(rows, dtype) for rows in not_empty]), dtype)
    if not_empty:
        return not_empty[0]
    return parts[0] if parts else no_rows(dtype)


def copy_rows(rows: Rows, dtype: np.dtype[np.void]) -> Rows:
    """Return a copy of rows of `dtype`, whose dtype is this object.

    Kernels return arrays with dtype objects of their own; to compare two of them, or to pass them
    to a kernel, takes longer than a dtype that is identical.

    Raises:
        ValueError: the rows are of another dtype.
    """
    return _from_bytes(_to_bytes(rows, dtype), dtype)


def machine_ids_in(rows: Rows) -> list[int]:
    """Return the distinct machine ids of rows, in ascending order."""
    return sorted(set(rows["machine_id"].tolist())) if rows.size else []


def rows_of_machine(rows: Rows, machine_id: int) -> Rows:
    """Return the rows of one machine; the same array, not a copy, if all rows are."""
    if are_of_machine(rows, machine_id):
        return rows
    own: Rows = rows[rows["machine_id"] == machine_id]
    return own


def are_of_machine(rows: Rows, machine_id: int) -> bool:
    """Return whether all rows are of one machine."""
    if rows.size == 0:
        return True
    # For a few rows faster than NumPy.
    return bool(rows["machine_id"].tolist().count(machine_id) == rows.size)


def has_kind(conversions: Rows, kind: int) -> bool:
    """Return whether any of some CONVERSION rows is of a `ConversionKind`."""
    return kind in conversions["kind"].tobytes()  # a byte each; for a few rows faster than NumPy


def empty_rows(dtype: np.dtype[np.void], count: int = 0) -> Rows:
    """Return `count` rows of zeros."""
    return np.zeros(count, dtype=dtype)


@cache
def no_rows(dtype: np.dtype[np.void]) -> Rows:
    """Return an array without rows, the same one in all calls: NumPy takes 1 to 2 us to make it."""
    return empty_rows(dtype)


def _to_bytes(rows: Rows, dtype: np.dtype[np.void]) -> bytes:
    """Return the memory of rows: NumPy copies structured arrays field by field, in 5 us or more."""
    if rows.dtype != dtype:
        raise ValueError(f"rows of {rows.dtype} were given where {dtype} is required")
    return rows.tobytes()


def _from_bytes(data: bytes, dtype: np.dtype[np.void]) -> Rows:
    """Return the rows in a copy of their memory."""
    rows: Rows = np.frombuffer(bytearray(data), dtype)
    return rows
