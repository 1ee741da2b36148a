"""The soil's end of the exchange: the barrier of the tick and the keeper of the ledger.

A state machine without a clock or a network, as `machine_side`. The soil calls `poll` until a tick
is complete, works on its rows, and gives what it moved to `answer`, which numbers the rows, books
them and posts them to all machines::

    expected sources join -> answer 0 (welcome) -> poll: tick 1 complete -> answer 1 -> ...

In lockstep a tick is complete with every machine's part. A machine may have sent the next one
already (`AHEAD`), whose turn comes after. In real time the soil may go on without
a late machine, whose part then counts in a later tick: its receipt tells it which.
"""

from __future__ import annotations

from collections import deque
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
    Refusal,
    Resend,
    RowChunk,
    RowRange,
    SoilHeader,
    Stream,
    Verb,
)
from msg_bridge.contract.rows import LANDED, SWEEP, Rows, empty_rows, join_rows
from msg_bridge.exchange.accounts import Accounts
from msg_bridge.exchange.chunks import chunked
from msg_bridge.exchange.source import Source
from msg_bridge.exchange.streams import AHEAD, Outgoing

__all__ = ["SoilExchange", "TickInput"]

_LAST_SOURCE, _LAST_LIFE = 2**16 - 1, 2**32 - 1
"""What fits the fields of rows."""

_KEPT = 64
"""Headers that can be said again."""


@dataclass(frozen=True)
class TickInput:
    """Everything the machines sent for one tick; its rows are not to be written to.

    Attributes:
        tick: its number; 0 is the welcome, before anything has moved.
        sweeps: SWEEP rows, by source and seq.
        landed: LANDED rows, by source and seq.
    """

    tick: int
    sweeps: Rows
    landed: Rows


Layers = tuple[NDArray[np.int64], NDArray[np.uint8], NDArray[np.uint8]]


class SoilExchange:
    """Numbered streams to all machines, receipts from each, and the accounts.

    Attributes:
        epoch: raised by every reset.
        tick: the last tick answered; -1 before the welcome.
        ledger: of the last tick answered, None before the welcome.
        accounts: soil that is not terrain.
        refused: why the latest join of a source was refused, by source.
    """

    def __init__(
        self,
        grid: Grid,
        elevation: Callable[[], NDArray[np.float64]],
        *,
        layers: Callable[[], Layers] | None = None,
        expected: Iterable[int] = (1,),
        epoch: int = 1,
    ) -> None:
        """
        Args:
            grid: of the terrain.
            elevation: gives the surface as it is now [m], shape (rows, cols).
            layers: gives what it is of: `volume_mm3`, `soil` and `moisture` of a `Keyframe`.
            expected: sources without which tick 1 does not begin.
            epoch: number of this run.
        """
        self.epoch = epoch
        self.tick = -1
        self.ledger: Ledger | None = None
        self.accounts = Accounts()
        self.refused: dict[int, Refusal] = {}
        self._grid = grid
        self._elevation = elevation
        self._layers = layers
        self._expected = frozenset(expected)
        self._sources: dict[int, Source] = {}
        self._joining: dict[int, MachineHeader] = {}
        self._lives: dict[int, int] = {}
        self._out = {s: Outgoing(s) for s in (Stream.CONVERSION, Stream.CHANGED, Stream.FORCE)}
        self._last: SoilHeader | None = None
        self._said: deque[SoilHeader] = deque(maxlen=_KEPT)
        self._taken: tuple[int, ...] = ()  # sources whose part is in the tick that was polled
        self._outbox: list[Message] = []

    @property
    def joined(self) -> tuple[int, ...]:
        """Sources that take part, in order."""
        return tuple(sorted(self._sources))

    @property
    def late(self) -> tuple[int, ...]:
        """Sources whose tick the soil is waiting for."""
        return tuple(n for n in self.joined if not self._sources[n].complete())

    @property
    def releasable(self) -> tuple[int, ...]:
        """Absent sources whose soil can be released: those that are not about to come back."""
        return tuple(n for n in self.accounts.absent if n not in self._joining)

    @property
    def lacks_rows(self) -> bool:
        """Whether a machine's header is here and rows that it counts are not."""
        return any(self._sources[n].header is not None for n in self.late)

    def receive(self, message: Message) -> None:
        """Take one message from a machine; those of another epoch or life are ignored.

        Raises:
            ExchangeError: it breaks the exchange; nothing was changed.
        """
        if message.epoch != self.epoch:
            return
        if isinstance(message, MachineHeader):
            if message.verb in (Verb.JOIN, Verb.RETURN):
                self._receive_join(message)
            elif message.tick <= self.tick + 1 + AHEAD:
                source = self._alive(message.source, message.life)
                if source is not None:
                    source.take_header(message)
        elif isinstance(message, RowChunk):
            source = self._alive(message.source, message.life)
            if source is not None:
                source.take_rows(message)
        elif isinstance(message, Resend):
            self._resend(message)

    def poll(self, *, wait: bool = True) -> TickInput | None:
        """The next tick, once every joined source's part of it is here.

        Tick 0, without rows, comes once all expected sources have asked to join.

        Args:
            wait: for late sources, and for a first one. If not, the tick has the parts that are
                here; a late one counts in the tick that is polled once it has come.
        """
        if self.tick < 0:
            if not self._expected <= set(self._joining):
                return None
            return TickInput(0, empty_rows(SWEEP), empty_rows(LANDED))
        late = self.late
        if wait and (late or not (self._sources or self._joining)):
            return None
        self._taken = tuple(n for n in self.joined if n not in late)
        sweeps, landed = [], []
        for number in self._taken:
            source = self._sources[number]
            assert source.header is not None
            sweeps.append(source.sweeps.rows(source.header.sweeps))
            landed.append(source.landed.rows(source.header.landed))
        return TickInput(self.tick + 1, join_rows(sweeps, SWEEP), join_rows(landed, LANDED))

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

        Raises:
            ExchangeError: conversions for a source that takes no part; nothing was changed.
        """
        self.accounts.check(conversions)
        self.tick += 1
        conversions, conversion_range = self._out[Stream.CONVERSION].append(conversions)
        changed, changed_range = self._out[Stream.CHANGED].append(changed)
        forces, force_range = self._out[Stream.FORCE].append(forces)
        self.accounts.book(conversion_range, conversions)
        for number in self._taken:
            self._finish(self._sources[number])
        self._taken = ()
        admitted = self._admit(conversion_range.last)
        header = SoilHeader(
            self.epoch,
            self.tick,
            revision,
            conversions=conversion_range,
            changed=changed_range,
            forces=force_range,
            receipts=tuple(self._sources[n].receipt for n in self.joined),
        )
        for source in self._sources.values():
            source.told(header)
        self._last = header
        self._said.append(header)
        # The header last: who has it can expect to have the rows.
        self._post(Stream.CONVERSION, conversions)
        self._post(Stream.CHANGED, changed)
        self._post(Stream.FORCE, forces)
        self._outbox.append(header)
        self._welcome(admitted)
        self._forget(header)
        self.ledger = self.accounts.ledger(self.tick, terrain_mm3)
        return self.ledger

    def drop(self, source: int) -> None:
        """Go on without a joined source that has fallen silent; what it holds is absent now.

        It notices by the next header, and may come back with what it holds.

        Raises:
            ExchangeError: it takes no part.
        """
        if source not in self._sources:
            raise ExchangeError(f"machine {source} takes no part; it cannot be dropped")
        self.accounts.leave(source)
        del self._sources[source]

    def release(self, source: int) -> int:
        """Take over what an absent source held [mm^3]; it cannot come back with it any more.

        The next `answer` must have DEPOSIT or OUTSIDE rows of this source over all of it.

        Raises:
            ExchangeError: it takes part, or is waiting to come back.
        """
        if source in self._sources or source in self._joining:
            raise ExchangeError(
                f"machine {source} takes part; what it holds can be released once it has left"
            )
        return self.accounts.release(source)

    def remind(self) -> None:
        """Ask again for what has not come, and say again where the run stands."""
        if self._last is not None:
            self._outbox.append(self._last)
        for number in self.late:
            source = self._sources[number]
            if source.header is None:
                missing = [(Stream.HEADER, RowRange(self.tick + 1, 1))]
            else:
                missing = source.gaps()
            for stream, gap in missing:
                self._outbox.append(
                    Resend(self.epoch, number, source.life, stream, gap.first, gap.count)
                )

    def take_outbox(self) -> list[Message]:
        """The messages to carry to all machines, in order; empties the box."""
        out, self._outbox = self._outbox, []
        return out

    def _alive(self, number: int, life: int) -> Source | None:
        source = self._sources.get(number)
        return source if source is not None and source.life == life else None

    def _receive_join(self, header: MachineHeader) -> None:
        number, life = header.source, header.life
        if not (1 <= number <= _LAST_SOURCE and 1 <= life <= _LAST_LIFE):
            raise ExchangeError(
                f"source {number} asks to join in life {life}; give it a source from 1 to"
                f" {_LAST_SOURCE} and a life from 1 to {_LAST_LIFE}"
            )
        if self._alive(number, life) is not None:
            if self._last is not None:  # its welcome was lost
                self._outbox.append(self._last)
                self._welcome([number])
        elif life > self._lives.get(number, 0):
            if number in self._sources:
                # Its former life ended without a word.
                self.accounts.leave(number)
                del self._sources[number]
            self._joining[number] = header
            self._lives[number] = life
        elif number in self.refused and self.refused[number].life == life:
            self._outbox.append(self.refused[number])
        elif life < self._lives.get(number, 0) or number not in self._joining:
            reason = f"source {number} has had life {self._lives.get(number, 0)}; join anew"
            self._outbox.append(Refusal(self.epoch, number, life, reason))

    def _finish(self, source: Source) -> None:
        """Close the tick of one source: its totals, its acknowledgement, its rows."""
        header = source.finish()
        self.accounts.report(header)
        if header.verb is Verb.LEAVE:
            self.accounts.leave(header.source)
            del self._sources[header.source]

    def _admit(self, published: int) -> list[int]:
        """Let waiting sources in, as of this tick; returns their numbers.

        Args:
            published: last conversion row published so far.
        """
        admitted = []
        for number, header in sorted(self._joining.items()):
            try:
                if header.verb is Verb.RETURN:
                    self.accounts.come_back(header, published)
                else:
                    self.accounts.join(number, published)
            except ExchangeError as error:
                refusal = Refusal(self.epoch, number, header.life, str(error))
                self.refused[number] = refusal
                self._outbox.append(refusal)
                continue
            self.refused.pop(number, None)
            owed = self.accounts.owed(number)
            self._sources[number] = Source(number, header.life, owed, self.tick)
            admitted.append(number)
        self._joining.clear()
        return admitted

    def _forget(self, answered: SoilHeader) -> None:
        """Forget rows that every source has; conversions once they are applied."""
        has = [source.acknowledged for source in self._sources.values()] or [answered.spans]
        for stream in (Stream.CHANGED, Stream.FORCE):
            self._out[stream].forget(min(spans[stream].last for spans in has))
        self._out[Stream.CONVERSION].forget(self.accounts.acknowledged_by_all)

    def _welcome(self, numbers: list[int]) -> None:
        """Post the terrain, and the rows each is owed."""
        if numbers:
            self._outbox.append(self._keyframe())
        for number in numbers:
            source = self._sources[number]
            self._post_owed(source, RowRange(1, source.owed_count))

    def _post_owed(self, source: Source, wanted: RowRange) -> None:
        rows = source.owed.again(wanted)
        self._outbox.extend(
            chunked(self.epoch, Stream.OWED, rows, source=source.source, life=source.life)
        )

    def _keyframe(self) -> Keyframe:
        assert self._last is not None
        layers = () if self._layers is None else self._layers()
        surface = self._elevation().copy()
        return Keyframe(self.epoch, self._last.revision, self._grid, surface, *layers)

    def _resend(self, request: Resend) -> None:
        if self._last is None:
            return
        wanted = RowRange(request.first, request.count)
        if request.stream is Stream.HEADER:
            # A machine that leaves is content with any header from its last tick on.
            self._outbox.extend(said for said in self._said if said.tick >= request.first)
        elif (source := self._alive(request.source, request.life)) is not None:
            if request.stream is Stream.KEYFRAME:
                self._outbox.append(self._keyframe())
            elif request.stream is Stream.OWED:
                self._post_owed(source, wanted)
            elif request.stream in self._out:
                self._post(request.stream, self._out[request.stream].again(wanted))

    def _post(self, stream: Stream, rows: Rows) -> None:
        """Post rows to all."""
        self._outbox.extend(chunked(self.epoch, stream, rows))
