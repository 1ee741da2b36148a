"""The soil's end of the exchange: the barrier of the tick and the keeper of the ledger.

A state machine without a clock or a network, as `machine_side`. The soil calls `poll` until a tick
is complete, works on its rows, and gives what it moved to `answer`, which numbers the rows, books
them and posts them to all machines::

    expected sources join -> answer 0 (welcome) -> poll: tick 1 complete -> answer 1 -> ...
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import (
    Keyframe,
    MachineHeader,
    Message,
    Resend,
    RowChunk,
    RowRange,
    SoilHeader,
    SourceReceipt,
    Stream,
    Verb,
)
from msg_bridge.contract.rows import LANDED, SWEEP, Rows, empty_rows
from msg_bridge.exchange.accounts import Accounts
from msg_bridge.exchange.chunks import chunked
from msg_bridge.exchange.streams import Incoming, Outgoing

__all__ = ["SoilExchange", "TickInput"]


@dataclass(frozen=True)
class TickInput:
    """Everything the machines sent for one tick.

    Attributes:
        tick: its number; 0 is the welcome, before anything has moved.
        sweeps: SWEEP rows, by source and seq.
        landed: LANDED rows, by source and seq.
    """

    tick: int
    sweeps: Rows
    landed: Rows


class _Source:
    """What the soil holds of one joined machine."""

    def __init__(self, source: int) -> None:
        self.source = source
        self.header: MachineHeader | None = None
        self.sweeps = Incoming(Stream.SWEEP)
        self.landed = Incoming(Stream.LANDED)

    def gaps(self) -> list[tuple[Stream, RowRange]]:
        """Rows the header counts that are not here."""
        assert self.header is not None
        return [(Stream.SWEEP, gap) for gap in self.sweeps.missing(self.header.sweeps)] + [
            (Stream.LANDED, gap) for gap in self.landed.missing(self.header.landed)
        ]

    def complete(self) -> bool:
        """Whether the tick's header and all rows it counts are here."""
        return self.header is not None and not self.gaps()


class SoilExchange:
    """Numbered streams to all machines, receipts from each, and the accounts.

    Attributes:
        epoch: raised by every reset.
        tick: the last tick answered; -1 before the welcome.
        ledger: of the last tick answered, None before the welcome.
        refused: why joins were refused, newest last.
    """

    def __init__(
        self,
        grid: Grid,
        elevation: Callable[[], NDArray[np.float64]],
        *,
        expected: Iterable[int] = (1,),
        epoch: int = 1,
    ) -> None:
        """
        Args:
            grid: of the terrain.
            elevation: gives the surface as it is now [m], shape (rows, cols).
            expected: sources without which tick 1 does not begin.
            epoch: number of this run.
        """
        self.epoch = epoch
        self.tick = -1
        self.ledger: Ledger | None = None
        self.refused: list[str] = []
        self._grid = grid
        self._elevation = elevation
        self._expected = frozenset(expected)
        self._sources: dict[int, _Source] = {}
        self._joining: dict[int, MachineHeader] = {}
        self._away: dict[int, _Source] = {}
        self._accounts = Accounts()
        self._out = {s: Outgoing(s) for s in (Stream.CONVERSION, Stream.CHANGED, Stream.FORCE)}
        self._last_header: SoilHeader | None = None
        self._outbox: list[Message] = []

    @property
    def joined(self) -> tuple[int, ...]:
        """Sources that take part, in order."""
        return tuple(sorted(self._sources))

    @property
    def late(self) -> tuple[int, ...]:
        """Sources whose tick the soil is waiting for."""
        return tuple(n for n in self.joined if not self._sources[n].complete())

    def receive(self, message: Message) -> None:
        """Take one message from a machine; those of another epoch or unknown source are ignored."""
        if message.epoch != self.epoch:
            return
        if isinstance(message, MachineHeader):
            self._receive_header(message)
        elif isinstance(message, RowChunk) and message.source in self._sources:
            source = self._sources[message.source]
            if message.stream not in (Stream.SWEEP, Stream.LANDED):
                raise ExchangeError(f"machines send no {message.stream.name} rows")
            (source.sweeps if message.stream is Stream.SWEEP else source.landed).add(message.rows)
        elif isinstance(message, Resend):
            self._resend(message)

    def poll(self) -> TickInput | None:
        """The next tick, once every joined source's part of it is here.

        Tick 0, without rows, comes once all expected sources have asked to join.
        """
        if self.tick < 0:
            if not self._expected <= set(self._joining):
                return None
            return TickInput(0, empty_rows(SWEEP), empty_rows(LANDED))
        if self.late or not (self._sources or self._joining):
            return None
        sweeps, landed = [empty_rows(SWEEP)], [empty_rows(LANDED)]
        for number in self.joined:
            source = self._sources[number]
            assert source.header is not None
            sweeps.append(source.sweeps.rows(source.header.sweeps))
            landed.append(source.landed.rows(source.header.landed))
        return TickInput(self.tick + 1, np.concatenate(sweeps), np.concatenate(landed))

    def answer(
        self, conversions: Rows, forces: Rows, changed: Rows, *, revision: int, terrain_mm3: int
    ) -> Ledger:
        """Number, book and post what the soil moved in the polled tick, and begin the next.

        Args:
            conversions, forces, changed: rows of those types, `seq` not yet given.
            revision: of the terrain after the tick.
            terrain_mm3: the terrain's own count.

        Returns:
            The ledger of the tick.
        """
        self.tick += 1
        posted = {
            stream: self._out[stream].append(rows)
            for stream, rows in (
                (Stream.CONVERSION, conversions),
                (Stream.CHANGED, changed),
                (Stream.FORCE, forces),
            )
        }
        self._accounts.book(posted[Stream.CONVERSION][0])
        for source in list(self._sources.values()):
            self._finish(source)
        self._admit()
        header = SoilHeader(
            self.epoch,
            self.tick,
            revision,
            conversions=posted[Stream.CONVERSION][1],
            changed=posted[Stream.CHANGED][1],
            forces=posted[Stream.FORCE][1],
            receipts=tuple(
                # Memory is all there is to be durable in until sides keep a journal.
                SourceReceipt(n, s.landed.received, s.landed.received)
                for n, s in sorted(self._sources.items())
            ),
        )
        self._last_header = header
        self._outbox.append(header)
        for stream, (rows, _) in posted.items():
            self._outbox.extend(chunked(self.epoch, stream, 0, rows))
        self._forget(posted[Stream.CHANGED][1], posted[Stream.FORCE][1])
        self.ledger = self._accounts.ledger(self.tick, terrain_mm3)
        return self.ledger

    def remind(self) -> None:
        """Ask again for what has not come."""
        for number in self.late:
            source = self._sources[number]
            if source.header is None:
                self._outbox.append(Resend(self.epoch, number, Stream.HEADER, self.tick + 1))
            else:
                for stream, gap in source.gaps():
                    self._outbox.append(Resend(self.epoch, number, stream, gap.first, gap.count))

    def take_outbox(self) -> list[Message]:
        """The messages to carry to all machines, in order; empties the box."""
        out, self._outbox = self._outbox, []
        return out

    def _receive_header(self, header: MachineHeader) -> None:
        source = self._sources.get(header.source)
        if header.verb is Verb.JOIN:
            if source is None:
                self._joining[header.source] = header
            elif self._last_header is not None:
                self._outbox.append(self._last_header)  # the welcome was lost
        elif source is not None and header.tick == self.tick + 1:
            source.header = header

    def _finish(self, source: _Source) -> None:
        """Close the tick of one source: its totals, its acknowledgement, its rows."""
        header = source.header
        assert header is not None
        self._accounts.report(
            header.source,
            pending=header.pending_mm3,
            particles=header.particles_mm3,
            acknowledged=header.conversions_received,
        )
        source.sweeps.forget(header.sweeps.last)
        source.landed.forget(header.landed.last)
        source.header = None
        if header.verb is Verb.LEAVE:
            self._accounts.leave(header.source)
            self._away[header.source] = self._sources.pop(header.source)

    def _admit(self) -> None:
        """Let waiting sources in: they are listed in this tick's header."""
        for number, header in sorted(self._joining.items()):
            held = header.pending_mm3 + header.particles_mm3
            try:
                self._accounts.join(number, held, acknowledged=header.conversions_received)
            except ExchangeError as error:
                self.refused.append(str(error))
                continue
            source = self._away.pop(number, _Source(number))
            if header.conversions_received == 0:
                source = _Source(number)  # a fresh start counts its rows from 1 again
            self._sources[number] = source
            self._outbox.append(self._keyframe())
        self._joining.clear()

    def _keyframe(self) -> Keyframe:
        revision = self._last_header.revision if self._last_header else 0
        return Keyframe(self.epoch, revision, self._grid, self._elevation().copy())

    def _resend(self, request: Resend) -> None:
        if request.stream is Stream.HEADER:
            if self._last_header is not None and self._last_header.tick == request.first:
                self._outbox.append(self._last_header)
        elif request.stream is Stream.KEYFRAME:
            self._outbox.append(self._keyframe())
        elif request.stream in self._out:
            rows = self._out[request.stream].again(request.first, request.count)
            self._outbox.extend(chunked(self.epoch, request.stream, 0, rows))

    def _forget(self, changed: RowRange, forces: RowRange) -> None:
        """Drop rows every source is through with; this tick's are still on their way."""
        self._out[Stream.CHANGED].forget(changed.first - 1)
        self._out[Stream.FORCE].forget(forces.first - 1)
        self._out[Stream.CONVERSION].forget(self._accounts.acknowledged_by_all)
