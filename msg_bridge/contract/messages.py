"""The messages that cross between soil and machines, whatever carries them.

A tick is told by headers; rows travel beside them in chunks. A side is through with tick k when it
holds the other's header k and every row that header counts. Rows are numbered from 1 in each
stream, so what is missing can be named and asked for again.

A machine takes part in *lives*: each join begins one, with a number larger than the last. Its
streams count from 1 in every life, and what belongs to another life is ignored.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import CONVERSION, DEPOSIT_REQUEST, FORCE, MAP_UPDATE, SWEEP, Rows

__all__ = [
    "STREAM_DTYPE",
    "JoinRejected",
    "Keyframe",
    "MachineHeader",
    "MachineReceipt",
    "Message",
    "RetransmitRequest",
    "RowChunk",
    "RowRange",
    "SoilHeader",
    "Stream",
    "Verb",
]


class Verb(IntEnum):
    """What a machine header says."""

    JOIN = 0
    """Take part from the next tick on, holding nothing."""
    REJOIN = 1
    """Take part again, holding what it held when it left."""
    STEP = 2
    LEAVE = 3
    """Take no part after this tick."""


class Stream(IntEnum):
    """What is numbered on its own, and can be asked for again."""

    HEADER = 0
    SWEEP = 1
    DEPOSIT_REQUEST = 2
    CONVERSION = 3
    MAP_UPDATE = 4
    FORCE = 5
    BACKLOG = 6
    """Conversion rows of a machine that came back, from before its return."""
    KEYFRAME = 7


STREAM_DTYPE: dict[Stream, np.dtype[np.void]] = {
    Stream.SWEEP: SWEEP,
    Stream.DEPOSIT_REQUEST: DEPOSIT_REQUEST,
    Stream.CONVERSION: CONVERSION,
    Stream.MAP_UPDATE: MAP_UPDATE,
    Stream.FORCE: FORCE,
    Stream.BACKLOG: CONVERSION,
}
"""Row type of each stream of rows."""


@dataclass(frozen=True)
class RowRange:
    """`count` rows of a stream from sequence number `first` on."""

    first: int = 1
    count: int = 0

    @property
    def last(self) -> int:
        """Sequence number of the last row; first - 1 if there is none."""
        return self.first + self.count - 1


@dataclass(frozen=True)
class MachineHeader:
    """A machine's word on one tick.

    Attributes:
        epoch: raised by every reset; older messages are ignored.
        source: the machine, from 1.
        life: raised by every join of this source.
        tick: the tick these rows belong to.
        verb: what it does.
        sweeps, landed: rows sent for this tick.
        conversions_received: last conversion row applied to the totals below.
        pending_mm3: parcels received and not yet particles, at the end of the tick.
        particles_mm3: live particles, frozen ones included, at the end of the tick.
        previous: the tick it sent before this one, or was welcomed in; tells whether one between
            is missing, since in real time a late machine leaves out numbers.
    """

    run_id: int
    machine_id: int
    session_id: int
    tick: int
    verb: Verb
    sweeps: RowRange = RowRange()
    deposit_requests: RowRange = RowRange()
    conversions_received: int = 0
    pending_mm3: int = 0
    particles_mm3: int = 0
    previous_tick: int = -1

    @property
    def soil_mm3(self) -> int:
        """All soil the machine holds."""
        return self.pending_mm3 + self.particles_mm3


@dataclass(frozen=True)
class MachineReceipt:
    """What the soil holds of one source.

    Attributes:
        source, life: whose.
        deposit_requests_received: last landed row received.
        owed: conversion rows it is owed from before its return.
        tick: the last of its ticks that was taken; older than the header's own where the soil went
            on without it.
    """

    machine_id: int
    session_id: int
    deposit_requests_received: int
    backlog: int = 0
    tick: int = 0


@dataclass(frozen=True)
class SoilHeader:
    """The soil's word on one tick.

    Attributes:
        epoch: raised by every reset.
        tick: the tick these rows answer.
        revision: of the terrain after the tick.
        conversions, changed, forces: rows sent for this tick.
        receipts: one per joined source; a source listed here takes part from the next tick on.
    """

    run_id: int
    tick: int
    revision: int
    conversions: RowRange
    map_updates: RowRange
    forces: RowRange
    receipts: tuple[MachineReceipt, ...]

    @cached_property  # looked at many times a tick
    def spans(self) -> dict[Stream, RowRange]:
        """The rows it counts, by stream."""
        return {
            Stream.CONVERSION: self.conversions,
            Stream.MAP_UPDATE: self.map_updates,
            Stream.FORCE: self.forces,
        }


@dataclass(frozen=True)
class RowChunk:
    """Rows of one stream.

    Attributes:
        source, life: the machine that sent them, or that OWED rows are for; 0 for what the soil
            sends to all.
    """

    run_id: int
    stream: Stream
    machine_id: int
    session_id: int
    rows: Rows


@dataclass(frozen=True)
class RetransmitRequest:
    """A request: rows [first, first + count) of a stream, or the header of tick `first`.

    Attributes:
        source, life: the machine that asks or is asked.
    """

    run_id: int
    machine_id: int
    session_id: int
    stream: Stream
    first: int
    count: int = 1


@dataclass(frozen=True)
class JoinRejected:
    """The soil's no to a join, with what to change."""

    run_id: int
    machine_id: int
    session_id: int
    reason: str


@dataclass(frozen=True)
class Keyframe:
    """The whole terrain surface, so that changed cells have something to change.

    Attributes:
        revision: of the terrain it shows.
        elevation: [m], shape (rows, cols), grid_map matrix order.
        volume_mm3: bank volume of each column above the floor, int64, likewise.
        soil: id of the kind at the surface, uint8, likewise.
        moisture: its [% of saturation], uint8, likewise.

    Layers that are not given are zeros.
    """

    run_id: int
    revision: int
    grid: Grid
    elevation: NDArray[np.float64]
    volume_mm3: NDArray[np.int64] = None  # type: ignore[assignment]
    soil: NDArray[np.uint8] = None  # type: ignore[assignment]
    moisture: NDArray[np.uint8] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        """Fill in the layers that are not given."""
        for name, kind in (("volume_mm3", np.int64), ("soil", np.uint8), ("moisture", np.uint8)):
            if getattr(self, name) is None:
                object.__setattr__(self, name, np.zeros(self.grid.shape, dtype=kind))


Message = MachineHeader | SoilHeader | RowChunk | RetransmitRequest | JoinRejected | Keyframe
