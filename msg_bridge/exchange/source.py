"""What the soil holds of one machine in one of its lives."""

from __future__ import annotations

from collections import deque

import numpy as np

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import (
    MachineHeader,
    RowChunk,
    RowRange,
    SoilHeader,
    SourceReceipt,
    Stream,
)
from msg_bridge.contract.rows import Rows
from msg_bridge.exchange.streams import AHEAD, Incoming, Outgoing, check_span

__all__ = ["Source"]

_MOST_HELD = 2**53
"""Soil that one machine may say it holds [mm^3], nine million cubic metres: sums stay int64."""

_SHOWN = 4


class Source:
    """One life of a joined machine: its rows, its words on its next ticks, and what it is owed.

    Attributes:
        source, life: whose.
        taken: the last of its ticks that was taken.
        sweeps, landed: its rows.
        owed: CONVERSION rows from before its return, numbered from 1.
        owed_count: how many.
    """

    def __init__(self, source: int, life: int, owed: Rows, tick: int) -> None:
        """Welcome it in the header of `tick`, which it must be `told` next."""
        self.source = source
        self.life = life
        self.taken = tick
        self.sweeps = Incoming(Stream.SWEEP)
        self.landed = Incoming(Stream.LANDED)
        self._streams = {Stream.SWEEP: self.sweeps, Stream.LANDED: self.landed}
        self.owed = Outgoing(Stream.OWED)
        self.owed_count = self.owed.append(owed)[1].count
        self._words: deque[MachineHeader] = deque()  # on ticks not taken yet, the oldest first
        # What it was told: (its tick that was answered, the answer), from what it certainly has on.
        self._told: deque[tuple[int, SoilHeader]] = deque()
        self._ticks = deque([self.taken], maxlen=AHEAD + 2)  # taken last

    @property
    def header(self) -> MachineHeader | None:
        """Its word on the tick that is being gathered, once it has come."""
        return self._words[0] if self._words else None

    @property
    def acknowledged(self) -> dict[Stream, RowRange]:
        """The soil's rows that it certainly has: the last of each stream that it was told of."""
        return self._told[0][1].spans

    @property
    def receipt(self) -> SourceReceipt:
        """What has come from it; memory is all there is to be durable in without a journal."""
        received = self.landed.received
        return SourceReceipt(
            self.source, self.life, received, received, self.owed_count, self.taken
        )

    def take_header(self, header: MachineHeader) -> None:
        """Take its word on its next tick; one that was taken says nothing new.

        Of words that come in another order than they were sent, the later one must come again.

        Raises:
            ExchangeError: it counts its rows wrongly, or tells what cannot be.
        """
        before = self._words[-1] if self._words else None
        newest = self.taken if before is None else before.tick
        if header.tick <= newest or header.previous != newest or len(self._words) > AHEAD:
            return
        for stream, span, had in (
            (self.sweeps, header.sweeps, None if before is None else before.sweeps),
            (self.landed, header.landed, None if before is None else before.landed),
        ):
            expected = stream.expected if had is None else had.last + 1
            check_span(span, stream.stream, expected)
        held = (header.pending_mm3, header.particles_mm3)
        if min(held) < 0 or max(held) > _MOST_HELD:
            raise ExchangeError(
                f"machine {self.source} says it holds {header.pending_mm3} + {header.particles_mm3}"
                f" mm^3 of soil; each must be 0 to {_MOST_HELD}"
            )
        applied = [answer.conversions.last for _, answer in self._told]
        if header.conversions_received not in applied:
            raise ExchangeError(
                f"machine {self.source} says it has applied conversion row"
                f" {header.conversions_received}; the answers that it can have had end with"
                f" {', '.join(map(str, applied[-_SHOWN:]))}"
            )
        self._words.append(header)

    def take_rows(self, chunk: RowChunk) -> None:
        """Take rows it sent.

        Raises:
            ExchangeError: rows that are not a machine's to send, or another machine's.
        """
        stream = self._streams.get(chunk.stream)
        if stream is None:
            raise ExchangeError(f"machines send no {chunk.stream.name} rows")
        names = chunk.rows.dtype.names or ()
        if "source" in names and np.count_nonzero(chunk.rows["source"] != chunk.source):
            raise ExchangeError(f"machine {chunk.source} sends rows of another source")
        stream.add(chunk.rows)

    def gaps(self) -> list[tuple[Stream, RowRange]]:
        """Rows the header counts that are not here."""
        header = self.header
        assert header is not None
        return [(Stream.SWEEP, gap) for gap in self.sweeps.missing(header.sweeps)] + [
            (Stream.LANDED, gap) for gap in self.landed.missing(header.landed)
        ]

    def complete(self) -> bool:
        """Whether the tick's header and all rows it counts are here."""
        header = self.header
        return header is not None and not (
            self.sweeps.missing(header.sweeps) or self.landed.missing(header.landed)
        )

    def finish(self) -> MachineHeader:
        """Forget the tick; returns its header."""
        header = self._words.popleft()
        self.sweeps.forget(header.sweeps.last)
        self.landed.forget(header.landed.last)
        if self.owed_count:
            self.owed.forget(self.owed_count)
            self.owed_count = 0
        self.taken = header.tick
        self._ticks.append(header.tick)
        return header

    def told(self, header: SoilHeader) -> None:
        """Note a header that is sent to it, and what it has had since it sent the tick taken."""
        self._told.append((self.taken, header))
        # Its tick was sent after the answer to the one AHEAD + 1 before.
        certain = self._ticks[0] if len(self._ticks) == AHEAD + 2 else self._told[0][0]
        while self._told[0][0] < certain:
            self._told.popleft()
