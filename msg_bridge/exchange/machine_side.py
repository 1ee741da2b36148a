"""The machine's end of the exchange, as a state machine without a clock or a network.

Messages go in by `receive` and come out by `take_outbox`; `remind` is called by whoever carries
them when nothing has come for a while, and asks again for what is missing::

    OUT -- join --> JOINING -- welcome --> READY -- send --> WAITING -- answer --> READY ...
                                             '-- send(leave) --> LEAVING -- let go --> OUT

It does not wait for the answer to the tick it has just sent, but for the one before (`AHEAD`):
soil and machine work at the same time. A machine that leaves takes nothing more: what the soil
moved for it in its last ticks is owed to it, and comes when it joins again. A soil that does not
wait (real time) may answer a tick late, in the header whose receipt says so, and drops a machine
that has been silent for long: that one is OUT, and may join again with what it holds.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import (
    Keyframe,
    MachineHeader,
    Message,
    Refusal,
    Resend,
    RowChunk,
    RowRange,
    SoilHeader,
    SourceReceipt,
    Stream,
    Verb,
)
from msg_bridge.contract.rows import CHANGED, CONVERSION, FORCE, Rows, empty_rows, rows_of
from msg_bridge.exchange.chunks import chunked
from msg_bridge.exchange.entry import Entry
from msg_bridge.exchange.streams import AHEAD, Outgoing
from msg_bridge.exchange.unanswered import Unanswered

__all__ = ["MachineExchange", "Phase", "TickAnswer"]


class Phase(Enum):
    """Where a machine stands."""

    OUT = "out"
    JOINING = "joining"
    READY = "ready"
    WAITING = "waiting"
    LEAVING = "leaving"


@dataclass(frozen=True)
class TickAnswer:
    """The soil's complete answer to a tick; its rows are not to be written to.

    Attributes:
        tick: the soil's tick that answers; in real time a later one than was sent.
        conversions: this source's CONVERSION rows, in order.
        forces: this source's FORCE rows.
        changed: CHANGED rows newer than the keyframe.
    """

    tick: int
    conversions: Rows
    forces: Rows
    changed: Rows


class MachineExchange:
    """One source's numbered streams, acknowledgements and place in the tick.

    Attributes:
        source: the machine's number, from 1.
        epoch: the run it takes part in.
        life: number of its latest join.
        phase: where it stands.
        tick: the last tick answered by the soil, once joined.
        sent_tick: the last tick sent; before any, the one it was welcomed in.
        keyframe: the terrain it joined on.
        owed: CONVERSION rows from before its return, to be applied before the first tick is sent.
        refusal: why the soil refused the latest join, empty if it did not.
        dropped: whether the soil went on without it for good.
    """

    def __init__(self, source: int, *, epoch: int = 1, life: int = 0) -> None:
        """
        Args:
            source: the machine's number, from 1.
            epoch: the run to take part in.
            life: a number below 2**32, not below any this source has used in this run; a process
                that may have been started again gives a larger one, the time in seconds say.
        """
        if not 1 <= source <= 65535:
            raise ExchangeError(f"source is {source}; number machines from 1 to 65535")
        self.source = source
        self.epoch = epoch
        self.life = life
        self.phase = Phase.OUT
        self.tick = self.sent_tick = -1
        self.keyframe: Keyframe | None = None
        self.owed: Rows = empty_rows(CONVERSION)
        self.refusal = ""
        self.dropped = False
        self._outbox: list[Message] = []
        self._applied: int | None = None  # last conversion row applied; None before any welcome
        self._sent: MachineHeader | None = None
        self._let_go: SoilHeader | None = None  # the first header that lists it no more
        self._begin_life()

    @property
    def joined(self) -> bool:
        """Whether it takes part."""
        return self.phase in (Phase.READY, Phase.WAITING, Phase.LEAVING)

    @property
    def waiting(self) -> bool:
        """Whether the next tick can only be sent once an answer has come in full."""
        return self.phase in (Phase.WAITING, Phase.LEAVING)

    @property
    def next_tick(self) -> int:
        """Number of the tick to be sent next; in real time, those it missed are left out."""
        return max(self.tick, self.sent_tick) + 1

    @property
    def unanswered(self) -> int:
        """Number of ticks sent and not answered."""
        return len(self._unanswered)

    @property
    def lacks_rows(self) -> bool:
        """Whether the header that is waited for is here and rows that it counts are not."""
        return self.phase is Phase.WAITING and self._unanswered.lacks_rows

    def join(self, *, pending_mm3: int = 0, particles_mm3: int = 0) -> None:
        """Ask to take part from the next tick on.

        One that was here before and has applied all it was answered comes back with what it holds,
        and is sent the rows it is owed.

        Raises:
            ExchangeError: it takes part already.
        """
        if self.phase is not Phase.OUT:
            raise ExchangeError(
                f"machine {self.source} is {self.phase.value}; it can join once out"
            )
        self.life += 1
        self._begin_life()
        self._sent = MachineHeader(
            self.epoch,
            self.source,
            self.life,
            self.tick,
            Verb.JOIN if self._applied is None else Verb.RETURN,
            conversions_received=self._applied or 0,
            conversions_durable=self._applied or 0,
            pending_mm3=pending_mm3,
            particles_mm3=particles_mm3,
        )
        self.phase = Phase.JOINING
        self._outbox.append(self._sent)

    def send(
        self,
        sweeps: Rows,
        landed: Rows,
        *,
        pending_mm3: int,
        particles_mm3: int,
        leave: bool = False,
    ) -> None:
        """Send the next tick.

        Args:
            sweeps: SWEEP rows.
            landed: LANDED rows; each particle stays frozen until its conversion comes.
            pending_mm3, particles_mm3: what the machine holds at the end of the tick, all
                conversions answered so far applied.
            leave: take no part after this tick.

        Raises:
            ExchangeError: not joined yet, or too many ticks are not answered yet.
        """
        if self.phase is not Phase.READY:
            raise ExchangeError(
                f"machine {self.source} is {self.phase.value}; a tick can be sent once it has"
                f" joined and all but the last {AHEAD} are answered"
            )
        sweeps, sweep_range = self._sweeps.append(sweeps)
        landed, landed_range = self._landed.append(landed)
        for rows in (sweeps, landed):
            if rows.size:
                rows["source"] = self.source
        assert self._applied is not None
        self._sent = MachineHeader(
            self.epoch,
            self.source,
            self.life,
            self.next_tick,
            Verb.LEAVE if leave else Verb.STEP,
            sweep_range,
            landed_range,
            self._applied,
            self._applied,
            pending_mm3,
            particles_mm3,
            self.sent_tick,
        )
        self.sent_tick = self._sent.tick
        self._unanswered.add(self._sent)
        if leave:
            self.phase = Phase.LEAVING
        elif len(self._unanswered) > AHEAD:
            self.phase = Phase.WAITING
        # The header last: who has it can expect to have the rows.
        self._post(Stream.SWEEP, sweeps)
        self._post(Stream.LANDED, landed)
        self._outbox.append(self._sent)

    def receive(self, message: Message) -> None:
        """Take one message from the soil; those of another epoch, source or life are ignored.

        Raises:
            ExchangeError: it breaks the exchange; nothing was changed.
        """
        if message.epoch != self.epoch or self.phase is Phase.OUT:
            return
        if isinstance(message, SoilHeader):
            self._receive_header(message)
        elif isinstance(message, RowChunk):
            mine = message.source == self.source and message.life == self.life
            if message.stream is Stream.OWED and mine and self.phase is Phase.JOINING:
                self._entry.owed.add(message.rows)
                self._enter()
            else:
                self._unanswered.take_rows(message)
        elif isinstance(message, Keyframe):
            if self.phase is Phase.JOINING:
                self._entry.take_keyframe(message)
                self._enter()
        elif isinstance(message, Refusal):
            if self.phase is Phase.JOINING and self._is_me(message.source, message.life):
                self.refusal = message.reason
                self.phase = Phase.OUT
        elif isinstance(message, Resend) and self._is_me(message.source, message.life):
            self._resend(message)

    def poll(self) -> TickAnswer | None:
        """The answer that is waited for, once all of it is here."""
        if self.phase is Phase.LEAVING and self._let_go is not None:
            self.phase = Phase.OUT
            nothing = (empty_rows(CONVERSION), empty_rows(FORCE), empty_rows(CHANGED))
            return TickAnswer(self._let_go.tick, *nothing)
        answered = self._unanswered.pop() if self.phase is Phase.WAITING else None
        if answered is None:
            return None
        header, rows = answered.header, answered.rows
        assert self.keyframe is not None
        self._sweeps.forget(answered.sent.sweeps.last)
        receipt = self._receipt(header)
        if receipt is not None:
            self._landed.forget(receipt.landed_durable)
        self.phase = Phase.READY
        self.tick = header.tick
        self._applied = header.conversions.last
        return TickAnswer(
            header.tick,
            rows_of(rows[Stream.CONVERSION], self.source),
            rows_of(rows[Stream.FORCE], self.source),
            _changed_since(self.keyframe.revision, rows[Stream.CHANGED]),
        )

    def remind(self) -> None:
        """Ask again for what has not come.

        One that takes its time over its next tick asks where the run stands: a sign of life, and
        it learns whether the soil has gone on without it.
        """
        if self._sent is None or self.phase is Phase.OUT:
            return
        if self.phase is Phase.JOINING:
            if self._entry.welcome is None:
                self._outbox.append(self._sent)
                self._ask(Stream.HEADER, RowRange(self._sent.tick, 1))
            else:
                for stream, span in self._entry.missing():
                    self._ask(stream, span)
            return
        waits = self._unanswered.without_answer()
        # Either the soil lacks part of our tick, and asks for it, or we lack its header.
        self._outbox.extend(waits)
        if waits or self.phase is Phase.READY:
            self._ask(Stream.HEADER, RowRange(waits[0].tick if waits else self.sent_tick, 1))
        for stream, span in self._unanswered.gaps():
            self._ask(stream, span)

    def take_outbox(self) -> list[Message]:
        """The messages to carry to the soil, in order; empties the box."""
        out = self._outbox
        self._outbox = []
        return out

    def _begin_life(self) -> None:
        """Streams of a life count from 1; nothing of an earlier life is left."""
        self._sweeps = Outgoing(Stream.SWEEP)
        self._landed = Outgoing(Stream.LANDED)
        self._unanswered = Unanswered()
        self._entry = Entry()
        self._outbox = []
        self._let_go = None
        self.keyframe = None
        self.owed = empty_rows(CONVERSION)
        self.refusal = ""
        self.dropped = False

    def _receive_header(self, header: SoilHeader) -> None:
        assert self._sent is not None
        receipt = self._receipt(header)
        if self.phase is Phase.JOINING:
            if receipt is not None and self._entry.welcome is None:
                self._entry.take_welcome(header, receipt)
                self._unanswered.begin(header)
                self._enter()
        elif self.phase is Phase.LEAVING:
            if receipt is None and header.tick >= self._sent.tick:
                self._let_go = header
        elif header.tick > self.tick:
            if receipt is None:
                self.phase = Phase.OUT
                self.dropped = True
            else:
                self._unanswered.take_header(header, receipt)

    def _enter(self) -> None:
        """Take part, once all that takes is here."""
        entry = self._entry
        if not entry.complete:
            return
        assert entry.welcome is not None
        self.keyframe = entry.keyframe
        self.owed = entry.owed_rows()
        self.tick = self.sent_tick = entry.welcome.tick
        self._applied = entry.welcome.conversions.last
        self.phase = Phase.READY

    def _receipt(self, header: SoilHeader) -> SourceReceipt | None:
        for receipt in header.receipts:
            if self._is_me(receipt.source, receipt.life):
                return receipt
        return None

    def _is_me(self, source: int, life: int) -> bool:
        return source == self.source and life == self.life

    def _resend(self, request: Resend) -> None:
        if request.stream is Stream.HEADER:
            self._outbox.extend(self._unanswered.sent(request.first))
        elif request.stream in (Stream.SWEEP, Stream.LANDED):
            kept = self._sweeps if request.stream is Stream.SWEEP else self._landed
            self._post(request.stream, kept.again(RowRange(request.first, request.count)))

    def _ask(self, stream: Stream, span: RowRange) -> None:
        request = Resend(self.epoch, self.source, self.life, stream, span.first, span.count)
        self._outbox.append(request)

    def _post(self, stream: Stream, rows: Rows) -> None:
        self._outbox.extend(chunked(self.epoch, stream, rows, source=self.source, life=self.life))


def _changed_since(revision: int, changed: Rows) -> Rows:
    """CHANGED rows of revisions after one."""
    if changed.size == 0:
        return changed
    # Revisions in rows are modulo 2**32, as sequence numbers are: half of all others are later.
    beyond_next = changed["revision"] - np.uint32((revision + 1) % 2**32)
    later = beyond_next < 2**31 - 1
    return changed if np.count_nonzero(later) == changed.size else changed[later]
