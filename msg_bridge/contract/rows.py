"""The rows that cross between soil and machines, as NumPy structured arrays.

Every row stream numbers its rows from 1 in `seq`; a gap is a lost row, a repeat is a duplicate.
Lengths are in metres of the map frame, volumes in mm^3 of bank (undisturbed) soil.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "CONVERSION",
    "DEPOSIT_REQUEST",
    "FORCE",
    "MAP_UPDATE",
    "MAX_ROW_VOLUME",
    "SWEEP",
    "ConversionKind",
    "Rows",
    "SoilReaction",
    "SweepAction",
    "empty_rows",
    "join_rows",
    "machine_ids_in",
    "rows_of_machine",
]

Rows = NDArray[np.void]
"""A one-dimensional structured array of one of the dtypes below."""

MAX_ROW_VOLUME = 2**32 - 1
"""Largest volume one row carries [mm^3]; more is split into several rows."""


class SweepAction(IntEnum):
    """What a tool does to the soil it sweeps."""

    CUT = 0
    COMPACT = 1
    """Pushes soil down without taking it: a track shoe, the back of a bucket."""
    MILL = 2
    """Takes soil all round by picks that spin: a cutting drum; its last pair is its first again."""


class SoilReaction(IntEnum):
    """What a FORCE row is of."""

    CUT = 0  # what the tool cuts resists it
    BEARING = 1  # what the tool stands on bears it
    MILL = 2  # what the picks of a drum cut resists them


class ConversionKind(IntEnum):
    """What a conversion row says was moved."""

    EXCAVATE = 0
    """Out of a column, credited to the source's pending account."""
    DEPOSIT = 1
    """A landed particle became terrain."""
    OUTSIDE = 2
    """A landed particle had left the map."""
    REJECT = 3
    """A landed row was malformed: the particle stays a particle."""


SWEEP = np.dtype(
    [
        ("x0", "<f4"),  # the key point at the tick's start
        ("y0", "<f4"),
        ("z0", "<f4"),
        ("x1", "<f4"),  # and at its end
        ("y1", "<f4"),
        ("z1", "<f4"),
        ("seq", "<u4"),
        ("pair", "<u2"),  # rows 2k and 2k+1 of a tool are the left and right end of pair k
        ("tool", "<u2"),
        ("machine_id", "<u2"),
        ("action", "u1"),  # Action
    ]
)
"""A tool's key points over one tick, machine to soil; both ends of a pair, lip first."""

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
"""A particle that came to rest, machine to soil. It stays the machine's until answered."""

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
        ("kind", "u1"),  # Kind
    ]
)
"""What was actually moved, soil to all. EXCAVATE: x, y, z is the centroid of the removed soil, and
`moisture` is that of what was taken. An answer to a landed row repeats its soil and moisture."""

MAP_UPDATE = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),  # elevation
        ("loose_depth", "<f4"),
        ("volume_mm3", "<f8"),  # exact: whole numbers below 2**53
        ("row", "<u4"),
        ("col", "<u4"),
        ("revision", "<u4"),
        ("seq", "<u4"),
        ("soil", "u1"),  # id of the kind at the surface
        ("moisture", "u1"),  # its, % of saturation
    ]
)
"""A column that is another than a tick ago, slip included, soil to all."""

FORCE = np.dtype(
    [
        ("x", "<f4"),  # where it acts
        ("y", "<f4"),
        ("z", "<f4"),
        ("fx", "<f4"),  # force [N] of the soil on the tool
        ("fy", "<f4"),
        ("fz", "<f4"),
        ("tx", "<f4"),  # torque [N m] about that point
        ("ty", "<f4"),
        ("tz", "<f4"),
        ("seq", "<u4"),
        ("tool", "<u2"),
        ("machine_id", "<u2"),
        ("reaction", "u1"),  # Holds
    ]
)
"""The most the soil holds a tool that swept with, soil to machine: what resists its cut, zero too,
and, where there is any, what bears it."""


def join_rows(parts: Sequence[Rows], dtype: np.dtype[np.void]) -> Rows:
    """Rows of `dtype`, one part after the other; a part that is all there is comes as it is.

    NumPy would find the common type of the parts anew each time, field by field.
    """
    some = [rows for rows in parts if rows.size]
    if len(some) > 1:
        return np.concatenate(some, dtype=dtype)
    return some[0] if some else empty_rows(dtype)


def machine_ids_in(rows: Rows) -> list[int]:
    """Sources that rows name, in order, each once."""
    sources = rows["machine_id"]
    if sources.size == 0:
        return []
    first = int(sources[0])
    if np.count_nonzero(sources == first) == sources.size:  # nearly always
        return [first]
    return [int(machine_id) for machine_id in np.unique(sources)]


def rows_of_machine(rows: Rows, machine_id: int) -> Rows:
    """The rows of one source; the very array where all are."""
    own = rows["machine_id"] == machine_id
    return rows if np.count_nonzero(own) == rows.size else rows[own]


def empty_rows(dtype: np.dtype[np.void], count: int = 0) -> Rows:
    """`count` zeroed rows of `dtype`."""
    return np.zeros(count, dtype=dtype)
