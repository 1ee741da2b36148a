"""Messages of the exchange between soil and machines, independent of their transport.

A header states what was done in a tick and counts the rows that belong to it; the rows are sent
beside it in chunks. A side has completed tick k when it has the other side's header k and every row
that this header counts. The rows of each stream are numbered from 1, so that missing rows can be
named and requested again.

A *run* begins when the soil starts or is reset and has its own number, `run_id`. A machine takes
part in *sessions*: each join begins one, with a number larger than that of the session before. Its
streams count from 1 in every session. Messages of another run or session are ignored.

`docs/concepts/exchange_protocol.md` describes the protocol.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.quick_init import quick_init
from msg_bridge.contract.row_ranges import NumberedRows, RowRange
from msg_bridge.contract.rows import CONVERSION, DEPOSIT_REQUEST, FORCE, MAP_UPDATE, SWEEP, Rows

__all__ = [
    "STREAM_DTYPE",
    "JoinRejected",
    "Keyframe",
    "MachineHeader",
    "MachineReceipt",
    "Message",
    "NumberedRows",
    "RetransmitRequest",
    "RowChunk",
    "RowRange",
    "SoilHeader",
    "Stream",
    "Verb",
]


class Verb(IntEnum):
    """Purpose of a machine header."""

    JOIN = 0
    """Take part from the next tick on, holding no soil."""
    REJOIN = 1
    """Take part again, holding the soil it left with."""
    STEP = 2
    """One tick."""
    LEAVE = 3
    """The last tick of the session."""


_TICK_VERBS = (Verb.STEP, Verb.LEAVE)


class Stream(IntEnum):
    """What is numbered separately and can be requested again."""

    HEADER = 0
    SWEEP = 1
    DEPOSIT_REQUEST = 2
    CONVERSION = 3
    MAP_UPDATE = 4
    FORCE = 5
    BACKLOG = 6
    """Conversion rows of a rejoining machine that were published while it took no part."""
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

_NO_ROWS = RowRange()


@quick_init
@dataclass(frozen=True)
class MachineHeader:
    """A machine's report of one tick.

    Attributes:
        run_id: number of the run.
        machine_id: number of the machine, from 1.
        session_id: number of the session, larger in each join of this machine.
        tick: the tick that the rows belong to.
        verb: purpose of the header.
        sweeps: SWEEP rows sent for this tick.
        deposit_requests: DEPOSIT_REQUEST rows sent for this tick.
        conversions_received: last conversion row included in the totals below; the soil may
            discard rows up to it.
        pending_mm3: volume of the parcels received and not yet turned into particles, at the end
            of the tick [mm^3].
        particles_mm3: volume of all live particles, frozen ones included, at the end of the tick
            [mm^3].
        previous_tick: the tick sent before this one, or that of the welcome. It shows whether a
            header is missing: in real time a late machine skips ticks.
        answered_tick: tick of the newest answer of the soil that was applied before this tick, or
            that of the welcome; with it a run can be repeated from its recording.
    """

    run_id: int
    machine_id: int
    session_id: int
    tick: int
    verb: Verb
    sweeps: RowRange = _NO_ROWS
    deposit_requests: RowRange = _NO_ROWS
    conversions_received: int = 0
    pending_mm3: int = 0
    particles_mm3: int = 0
    previous_tick: int = -1
    answered_tick: int = 0

    @property
    def is_tick(self) -> bool:
        """Whether it reports a tick; else it requests to join."""
        return self.verb in _TICK_VERBS

    @property
    def soil_mm3(self) -> int:
        """All soil that the machine holds [mm^3]."""
        return self.pending_mm3 + self.particles_mm3


@quick_init
@dataclass(frozen=True)
class MachineReceipt:
    """Acknowledgement of what the soil received from one joined machine.

    Attributes:
        machine_id, session_id: the machine and its session.
        deposit_requests_received: last DEPOSIT_REQUEST row processed; the machine may discard
            rows up to it.
        backlog: number of BACKLOG rows that a rejoining machine has to apply first.
        tick: the last of its ticks that was processed; older than the header's own if the soil
            continued without it.
        backlog_digest: digest of the BACKLOG rows.
    """

    machine_id: int
    session_id: int
    deposit_requests_received: int
    backlog: int = 0
    tick: int = 0
    backlog_digest: int = 0


@quick_init
@dataclass(frozen=True)
class SoilHeader:
    """The soil's report of one tick.

    Attributes:
        run_id: number of the run.
        tick: the tick that the rows belong to; 0 is the welcome, before the first tick.
        revision: revision of the terrain after the tick; it grows by one in each tick that changes
            a cell.
        conversions, map_updates, forces: rows sent for this tick.
        receipts: one for each joined machine. A machine listed here takes part from the next tick
            on; one that is not listed any more takes no part.
    """

    run_id: int
    tick: int
    revision: int
    conversions: RowRange
    map_updates: RowRange
    forces: RowRange
    receipts: tuple[MachineReceipt, ...]

    @cached_property  # read many times in a tick
    def spans(self) -> dict[Stream, RowRange]:
        """Row ranges by stream."""
        return {
            Stream.CONVERSION: self.conversions,
            Stream.MAP_UPDATE: self.map_updates,
            Stream.FORCE: self.forces,
        }


@quick_init
@dataclass(frozen=True)
class RowChunk:
    """Rows of one stream.

    Attributes:
        run_id: number of the run.
        stream: the stream.
        machine_id, session_id: sender of the rows, or recipient of BACKLOG rows; 0 for rows that
            the soil sends to all.
        rows: shape (n,), dtype `STREAM_DTYPE[stream]`.
        sent: as which the rows were sent, in the process of the sender.
    """

    run_id: int
    stream: Stream
    machine_id: int
    session_id: int
    rows: Rows
    sent: NumberedRows | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True)
class RetransmitRequest:
    """A request for rows [first, first + count) of a stream, or for headers from tick `first` on.

    Attributes:
        run_id: number of the run.
        machine_id, session_id: the machine that requests, or from which the soil requests.
        stream: the stream; KEYFRAME requests the terrain, for any range.
        first, count: the range.
    """

    run_id: int
    machine_id: int
    session_id: int
    stream: Stream
    first: int
    count: int = 1


@dataclass(frozen=True)
class JoinRejected:
    """The soil's rejection of a join, with the reason and what to change."""

    run_id: int
    machine_id: int
    session_id: int
    reason: str


@dataclass(frozen=True)
class Keyframe:
    """The complete terrain surface, to which map updates are applied.

    Layers that are not given are zeros.

    Attributes:
        run_id: number of the run.
        revision: revision of the terrain.
        grid: the grid.
        elevation: [m], shape (rows, cols), grid_map matrix order.
        volume_mm3: bank volume of each column above the floor [mm^3], int64, same shape.
        soil: id of the soil type at the surface, uint8, same shape.
        moisture: moisture at the surface [% of saturation], uint8, same shape.
        rut_depth: depth by which the surface was pressed down [m], float32, same shape.
    """

    run_id: int
    revision: int
    grid: Grid
    elevation: NDArray[np.float64]
    volume_mm3: NDArray[np.int64] = None  # type: ignore[assignment]
    soil: NDArray[np.uint8] = None  # type: ignore[assignment]
    moisture: NDArray[np.uint8] = None  # type: ignore[assignment]
    rut_depth: NDArray[np.float32] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        """Fill in the layers that are not given."""
        for name, kind in (
            ("volume_mm3", np.int64),
            ("soil", np.uint8),
            ("moisture", np.uint8),
            ("rut_depth", np.float32),
        ):
            if getattr(self, name) is None:
                object.__setattr__(self, name, np.zeros(self.grid.shape, dtype=kind))


@dataclass(frozen=True)
class KeyframeDue:
    """The transport must send the terrain, for a machine that joins.

    Instead of a `Keyframe`, where a transport sends terrain in its own way.

    Attributes:
        run_id: number of the run.
        revision: smallest revision of the terrain that may be sent.
    """

    run_id: int
    revision: int


Message = (
    MachineHeader
    | SoilHeader
    | RowChunk
    | RetransmitRequest
    | JoinRejected
    | Keyframe
    | KeyframeDue
)
