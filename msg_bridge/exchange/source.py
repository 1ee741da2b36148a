"""What the soil holds of one machine in one of its lives."""

from __future__ import annotations

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
from msg_bridge.exchange.streams import Incoming, Outgoing, check_span

__all__ = ["Source"]

_MOST_HELD = 2**53
"""Soil that one machine may say it holds [mm^3], nine million cubic metres: sums stay int64."""


class Source:
    """One life of a joined machine: its rows, its word on the tick, and what it is owed.

    Attributes:
        source, life: whose.
        taken: the last of its ticks that was taken.
        header: its word on the tick that is being gathered, once it has come.
        acknowledged: the soil's rows that it certainly has, the last number by stream.
        sweeps, landed: its rows.
        owed: CONVERSION rows from before its return, numbered from 1.
        owed_count: how many.
    """

    def __init__(self, source: int, life: int, owed: Rows, welcome: SoilHeader) -> None:
        """`welcome` is the first header that lists it."""
        self.source = source
        self.life = life
        self.taken = welcome.tick
        self.header: MachineHeader | None = None
        self._answer = welcome
        self.acknowledged = _last_rows(welcome)
        self.sweeps = Incoming(Stream.SWEEP)
        self.landed = Incoming(Stream.LANDED)
        self.owed = Outgoing(Stream.OWED)
        self.owed_count = self.owed.append(owed)[1].count

    @property
    def receipt(self) -> SourceReceipt:
        """What has come from it; memory is all there is to be durable in without a journal."""
        received = self.landed.received
        return SourceReceipt(
            self.source, self.life, received, received, self.owed_count, self.taken
        )

    def take_header(self, header: MachineHeader, published: int) -> None:
        """Take its word on its next tick; one that was taken says nothing new.

        Args:
            header: its word.
            published: last conversion row published so far.

        Raises:
            ExchangeError: it counts its rows wrongly, or tells what cannot be.
        """
        if header.tick <= self.taken:
            return
        check_span(header.sweeps, self.sweeps)
        check_span(header.landed, self.landed)
        if not all(0 <= held <= _MOST_HELD for held in (header.pending_mm3, header.particles_mm3)):
            raise ExchangeError(
                f"machine {self.source} says it holds {header.pending_mm3} + {header.particles_mm3}"
                f" mm^3 of soil; each must be 0 to {_MOST_HELD}"
            )
        had = self._answer.conversions.last
        if not had <= header.conversions_received <= published:
            raise ExchangeError(
                f"machine {self.source} says it has applied conversion row"
                f" {header.conversions_received}; it had {had} before, and {published} is the last"
            )
        self.header = header

    def take_rows(self, chunk: RowChunk) -> None:
        """Take rows it sent.

        Raises:
            ExchangeError: rows that are not a machine's to send, or another machine's.
        """
        streams = {Stream.SWEEP: self.sweeps, Stream.LANDED: self.landed}
        if chunk.stream not in streams:
            raise ExchangeError(f"machines send no {chunk.stream.name} rows")
        names = chunk.rows.dtype.names or ()
        if "source" in names and (chunk.rows["source"] != chunk.source).any():
            raise ExchangeError(f"machine {chunk.source} sends rows of another source")
        streams[chunk.stream].add(chunk.rows)

    def gaps(self) -> list[tuple[Stream, RowRange]]:
        """Rows the header counts that are not here."""
        assert self.header is not None
        return [(Stream.SWEEP, gap) for gap in self.sweeps.missing(self.header.sweeps)] + [
            (Stream.LANDED, gap) for gap in self.landed.missing(self.header.landed)
        ]

    def complete(self) -> bool:
        """Whether the tick's header and all rows it counts are here."""
        return self.header is not None and not self.gaps()

    def finish(self) -> MachineHeader:
        """Forget the tick; returns its header."""
        header = self.header
        assert header is not None
        self.sweeps.forget(header.sweeps.last)
        self.landed.forget(header.landed.last)
        self.owed = Outgoing(Stream.OWED)
        self.owed_count = 0
        self.taken = header.tick
        self.header = None
        return header

    def answered(self, header: SoilHeader) -> None:
        """Note that `header` answers the tick just taken: sent after it had the answer before."""
        self.acknowledged = _last_rows(self._answer)
        self._answer = header


def _last_rows(header: SoilHeader) -> dict[Stream, int]:
    return {stream: span.last for stream, span in header.spans.items()}
