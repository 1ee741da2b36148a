"""What the soil holds of one machine in one of its lives."""

from __future__ import annotations

from collections import deque

import numpy as np

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import (
    MachineHeader,
    MachineReceipt,
    RowChunk,
    RowRange,
    SoilHeader,
    Stream,
)
from msg_bridge.contract.rows import Rows
from msg_bridge.exchange.stream_buffers import (
    PIPELINE_DEPTH,
    ReceiveBuffer,
    SendBuffer,
    check_row_range,
)

__all__ = ["MachineSession"]

_MAX_REPORTED_VOLUME = 2**53
"""Soil that one machine may say it holds [mm^3], nine million cubic metres: sums stay int64."""

_MAX_ROWS_IN_MESSAGE = 4


class MachineSession:
    """One life of a joined machine: its rows, its words on its next ticks, and what it is owed.

    Attributes:
        source, life: whose.
        taken: the last of its ticks that was taken.
        sweeps, landed: its rows.
        owed: CONVERSION rows from before its return, numbered from 1.
        num_backlog_rows: how many.
    """

    def __init__(self, machine_id: int, session_id: int, backlog: Rows, tick: int) -> None:
        """Welcome it in the header of `tick`, which it must be `told` next."""
        self.machine_id = machine_id
        self.session_id = session_id
        self.last_tick = tick
        self.sweeps = ReceiveBuffer(Stream.SWEEP)
        self.deposit_requests = ReceiveBuffer(Stream.DEPOSIT_REQUEST)
        self._streams = {Stream.SWEEP: self.sweeps, Stream.DEPOSIT_REQUEST: self.deposit_requests}
        self.backlog = SendBuffer(Stream.BACKLOG)
        self.num_backlog_rows = self.backlog.append(backlog)[1].count
        self._pending_headers: deque[MachineHeader] = (
            deque()
        )  # on ticks not taken yet, the oldest first
        # What it was told: (its tick that was answered, the answer), from what it certainly has on.
        self._published_headers: deque[tuple[int, SoilHeader]] = deque()
        self._recent_ticks = deque([self.last_tick], maxlen=PIPELINE_DEPTH + 2)  # taken last

    @property
    def header(self) -> MachineHeader | None:
        """Its word on the tick that is being gathered, once it has come."""
        return self._pending_headers[0] if self._pending_headers else None

    @property
    def acknowledged(self) -> dict[Stream, RowRange]:
        """The soil's rows that it certainly has: the last of each stream that it was told of."""
        return self._published_headers[0][1].spans

    @property
    def receipt(self) -> MachineReceipt:
        """Return what the soil has received in this session."""
        return MachineReceipt(
            self.machine_id,
            self.session_id,
            self.deposit_requests.received,
            self.num_backlog_rows,
            self.last_tick,
        )

    def take_header(self, header: MachineHeader) -> None:
        """Take its word on its next tick; one that was taken says nothing new.

        Of words that come in another order than they were sent, the later one must come again.

        Raises:
            ExchangeError: it counts its rows wrongly, or tells what cannot be.
        """
        before = self._pending_headers[-1] if self._pending_headers else None
        newest = self.last_tick if before is None else before.tick
        if (
            header.tick <= newest
            or header.previous_tick != newest
            or len(self._pending_headers) > PIPELINE_DEPTH
        ):
            return
        for stream, span, had in (
            (self.sweeps, header.sweeps, None if before is None else before.sweeps),
            (
                self.deposit_requests,
                header.deposit_requests,
                None if before is None else before.deposit_requests,
            ),
        ):
            expected = stream.expected if had is None else had.last + 1
            check_row_range(span, stream.stream, expected)
        held = (header.pending_mm3, header.particles_mm3)
        if min(held) < 0 or max(held) > _MAX_REPORTED_VOLUME:
            raise ExchangeError(
                f"machine {self.machine_id} says it holds {header.pending_mm3} + {header.particles_mm3}"
                f" mm^3 of soil; each must be 0 to {_MAX_REPORTED_VOLUME}"
            )
        applied = [answer.conversions.last for _, answer in self._published_headers]
        if header.conversions_received not in applied:
            raise ExchangeError(
                f"machine {self.machine_id} says it has applied conversion row"
                f" {header.conversions_received}; the answers that it can have had end with"
                f" {', '.join(map(str, applied[-_MAX_ROWS_IN_MESSAGE:]))}"
            )
        self._pending_headers.append(header)

    def take_rows(self, chunk: RowChunk) -> None:
        """Take rows it sent.

        Raises:
            ExchangeError: rows that are not a machine's to send, or another machine's.
        """
        stream = self._streams.get(chunk.stream)
        if stream is None:
            raise ExchangeError(f"machines send no {chunk.stream.name} rows")
        names = chunk.rows.dtype.names or ()
        if "machine_id" in names and np.count_nonzero(chunk.rows["machine_id"] != chunk.machine_id):
            raise ExchangeError(f"machine {chunk.machine_id} sends rows of another source")
        stream.add(chunk.rows)

    def gaps(self) -> list[tuple[Stream, RowRange]]:
        """Rows the header counts that are not here."""
        header = self.header
        assert header is not None
        return [(Stream.SWEEP, gap) for gap in self.sweeps.missing(header.sweeps)] + [
            (Stream.DEPOSIT_REQUEST, gap)
            for gap in self.deposit_requests.missing(header.deposit_requests)
        ]

    def is_complete(self) -> bool:
        """Whether the tick's header and all rows it counts are here."""
        header = self.header
        return header is not None and not (
            self.sweeps.missing(header.sweeps)
            or self.deposit_requests.missing(header.deposit_requests)
        )

    def complete_tick(self) -> MachineHeader:
        """Forget the tick; returns its header."""
        header = self._pending_headers.popleft()
        self.sweeps.discard_through(header.sweeps.last)
        self.deposit_requests.discard_through(header.deposit_requests.last)
        if self.num_backlog_rows:
            self.backlog.discard_through(self.num_backlog_rows)
            self.num_backlog_rows = 0
        self.last_tick = header.tick
        self._recent_ticks.append(header.tick)
        return header

    def record_published(self, header: SoilHeader) -> None:
        """Note a header that is sent to it, and what it has had since it sent the tick taken."""
        self._published_headers.append((self.last_tick, header))
        # Its tick was sent after the answer to the one AHEAD + 1 before.
        certain = (
            self._recent_ticks[0]
            if len(self._recent_ticks) == PIPELINE_DEPTH + 2
            else self._published_headers[0][0]
        )
        while self._published_headers[0][0] < certain:
            self._published_headers.popleft()
