"""The machine's end of the exchange, as a state machine without a clock or a network.

Messages go in by `receive` and come out by `take_outbox`; `remind` is called by whoever carries
them when nothing has come for a while, and asks again for what is missing.

    join -> (welcome) -> send tick k -> (answer k) -> send tick k+1 -> ... -> leave
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import (
    Keyframe,
    MachineHeader,
    Message,
    Resend,
    RowChunk,
    RowRange,
    SoilHeader,
    Stream,
    Verb,
)
from msg_bridge.contract.rows import CHANGED, CONVERSION, FORCE, Rows, empty_rows
from msg_bridge.exchange.chunks import chunked
from msg_bridge.exchange.streams import Incoming, Outgoing

__all__ = ["MachineExchange", "TickAnswer"]


@dataclass(frozen=True)
class TickAnswer:
    """The soil's complete answer to a tick.

    Attributes:
        tick: the tick answered.
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
        tick: the last tick answered by the soil, once joined.
        keyframe: the terrain it joined on, once it has come.
    """

    def __init__(self, source: int, *, epoch: int = 1) -> None:
        if not 1 <= source <= 65535:
            raise ExchangeError(f"source is {source}; number machines from 1 to 65535")
        self.source = source
        self.epoch = epoch
        self.tick = 0
        self.keyframe: Keyframe | None = None
        self._sweeps = Outgoing(Stream.SWEEP)
        self._landed = Outgoing(Stream.LANDED)
        self._incoming: dict[Stream, Incoming] = {}
        self._conversions_applied = 0
        self._sent: MachineHeader | None = None
        self._answer: SoilHeader | None = None
        self._fresh = True
        self._joined = False
        self._waiting = False
        self._early: list[RowChunk] = []
        self._outbox: list[Message] = []

    @property
    def joined(self) -> bool:
        """Whether the soil has welcomed this source and its terrain has come."""
        return self._joined and self.keyframe is not None

    @property
    def waiting(self) -> bool:
        """Whether a tick has been sent and not been answered in full."""
        return self._waiting

    def join(self, *, pending_mm3: int = 0, particles_mm3: int = 0) -> None:
        """Ask to take part from the next tick on; a source that comes back tells what it holds."""
        self._sent = MachineHeader(
            self.epoch,
            self.source,
            self.tick,
            Verb.JOIN,
            conversions_received=self._conversions_applied,
            conversions_durable=self._conversions_applied,
            pending_mm3=pending_mm3,
            particles_mm3=particles_mm3,
        )
        self._joined = False
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
            ExchangeError: not joined yet, or the last tick is not answered yet.
        """
        if not self.joined or self._waiting:
            raise ExchangeError("a tick can be sent once joined and once the last one is answered")
        for rows in (sweeps, landed):
            rows["source"] = self.source
        sweeps, sweep_range = self._sweeps.append(sweeps)
        landed, landed_range = self._landed.append(landed)
        self._sent = MachineHeader(
            self.epoch,
            self.source,
            self.tick + 1,
            Verb.LEAVE if leave else Verb.STEP,
            sweep_range,
            landed_range,
            self._conversions_applied,
            self._conversions_applied,
            pending_mm3,
            particles_mm3,
        )
        self._waiting = True
        self._answer = None
        self._outbox.append(self._sent)
        self._post(Stream.SWEEP, sweeps)
        self._post(Stream.LANDED, landed)

    def receive(self, message: Message) -> None:
        """Take one message from the soil; those of another epoch or source are ignored."""
        if message.epoch != self.epoch:
            return
        if isinstance(message, SoilHeader):
            self._receive_header(message)
        elif isinstance(message, RowChunk) and message.source == 0:
            if self._incoming:
                self._incoming[message.stream].add(message.rows)
            else:
                self._early.append(message)  # overtook the welcome
        elif isinstance(message, Keyframe):
            if self.keyframe is None or message.revision > self.keyframe.revision:
                self.keyframe = message
        elif isinstance(message, Resend) and message.source == self.source:
            self._resend(message)

    def poll(self) -> TickAnswer | None:
        """The answer to the tick sent, once all of it is here."""
        header = self._answer
        if not self._waiting or header is None:
            return None
        if header.tick > self.tick + 1:
            return self._gone(header)
        if self._gaps(header):
            return None
        spans = self._spans(header)
        rows = {stream: self._incoming[stream].rows(span) for stream, span in spans.items()}
        for stream, span in spans.items():
            self._incoming[stream].forget(span.last)
        for receipt in header.receipts:
            if receipt.source == self.source:
                self._landed.forget(receipt.landed_durable)
        assert self._sent is not None
        assert self.keyframe is not None
        self._sweeps.forget(self._sent.sweeps.last)
        self._waiting = False
        self.tick = header.tick
        self._conversions_applied = header.conversions.last
        if self._sent.verb is Verb.LEAVE:
            self._part()
        own = {
            stream: rows[stream][rows[stream]["source"] == self.source]
            for stream in (Stream.CONVERSION, Stream.FORCE)
        }
        changed = rows[Stream.CHANGED]
        changed = changed[changed["revision"] > self.keyframe.revision]
        return TickAnswer(header.tick, own[Stream.CONVERSION], own[Stream.FORCE], changed)

    def remind(self) -> None:
        """Ask again for what has not come."""
        if self._sent is None:
            return
        if self._sent.verb is Verb.JOIN and not self._joined:
            self._outbox.append(self._sent)
        elif self.keyframe is None:
            self._ask(Stream.KEYFRAME, RowRange(0, 1))
        elif self._waiting and self._answer is None:
            # Either the soil lacks part of our tick, and asks for it, or we lack its header.
            self._outbox.append(self._sent)
            self._ask(Stream.HEADER, RowRange(self._sent.tick, 1))
        elif self._waiting and self._answer is not None:
            for stream, span in self._gaps(self._answer):
                self._ask(stream, span)

    def take_outbox(self) -> list[Message]:
        """The messages to carry to the soil, in order; empties the box."""
        out, self._outbox = self._outbox, []
        return out

    def _receive_header(self, header: SoilHeader) -> None:
        listed = any(receipt.source == self.source for receipt in header.receipts)
        joining = self._sent is not None and self._sent.verb is Verb.JOIN and not self._joined
        if joining and listed:
            self._welcome(header)
            return
        answers = self._waiting and header.tick == self.tick + 1
        passed_by = self._leaving and header.tick > self.tick + 1 and not listed
        if answers or passed_by:
            self._answer = header

    @property
    def _leaving(self) -> bool:
        return self._waiting and self._sent is not None and self._sent.verb is Verb.LEAVE

    def _gone(self, header: SoilHeader) -> TickAnswer:
        """The soil has let this source go and moved on; rows it is owed wait for its return."""
        self._waiting = False
        self._part()
        nothing = (empty_rows(CONVERSION), empty_rows(FORCE), empty_rows(CHANGED))
        return TickAnswer(header.tick, *nothing)

    def _part(self) -> None:
        """Leave; a source that held nothing comes back as a new one, counting from 1."""
        assert self._sent is not None
        self._joined = False
        self.keyframe = None
        self._incoming = {}
        if self._sent.pending_mm3 == 0 and self._sent.particles_mm3 == 0:
            self._fresh = True
            self._conversions_applied = 0
            self._sweeps = Outgoing(Stream.SWEEP)
            self._landed = Outgoing(Stream.LANDED)

    def _welcome(self, header: SoilHeader) -> None:
        """Count rows from the welcome on; conversions from the last one applied, if any."""
        self.tick = header.tick
        self._joined = True
        if self._fresh:
            self._conversions_applied = header.conversions.last
        self._fresh = False
        self._incoming = {
            Stream.CONVERSION: Incoming(Stream.CONVERSION, self._conversions_applied + 1),
            Stream.CHANGED: Incoming(Stream.CHANGED, header.changed.last + 1),
            Stream.FORCE: Incoming(Stream.FORCE, header.forces.last + 1),
        }
        for chunk in self._early:
            self._incoming[chunk.stream].add(chunk.rows)
        self._early.clear()
        self._sent = replace(self._sent, tick=header.tick) if self._sent else None

    def _gaps(self, header: SoilHeader) -> list[tuple[Stream, RowRange]]:
        return [
            (stream, gap)
            for stream, span in self._spans(header).items()
            for gap in self._incoming[stream].missing(span)
        ]

    def _resend(self, request: Resend) -> None:
        if request.stream is Stream.HEADER:
            if self._sent is not None and self._sent.tick == request.first:
                self._outbox.append(self._sent)
        elif request.stream in (Stream.SWEEP, Stream.LANDED):
            kept = self._sweeps if request.stream is Stream.SWEEP else self._landed
            self._post(request.stream, kept.again(request.first, request.count))

    def _ask(self, stream: Stream, span: RowRange) -> None:
        self._outbox.append(Resend(self.epoch, self.source, stream, span.first, span.count))

    def _post(self, stream: Stream, rows: Rows) -> None:
        self._outbox.extend(chunked(self.epoch, stream, self.source, rows))

    def _spans(self, header: SoilHeader) -> dict[Stream, RowRange]:
        """The rows this side needs to be through with the header's tick."""
        applied = self._conversions_applied
        return {
            # Conversions from before a source came back are owed to it, too.
            Stream.CONVERSION: RowRange(applied + 1, header.conversions.last - applied),
            Stream.CHANGED: header.changed,
            Stream.FORCE: header.forces,
        }
