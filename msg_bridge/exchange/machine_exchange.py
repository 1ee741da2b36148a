"""The machine's end of the exchange, as a state machine without clock and network.

Messages go in through `receive` and come out of `drain_outbox`. The owner calls `request_missing`
when there has been no progress for a while; it requests again what has not arrived::

    OUT -- join --> JOINING -- welcome --> READY -- send --> WAITING -- answer --> READY ...
                                             '-- send(leave) --> LEAVING -- confirmed --> OUT

A machine does not wait for the answer to the tick it has just sent, but for the one before
(`PIPELINE_DEPTH`), so that soil and machine compute at the same time. A leaving machine receives no
further rows: what the soil moved for it in its last ticks is its backlog, which it receives when it
rejoins. A soil that does not wait (real time) may answer a tick late, in the header whose receipt
names the tick. It may drop a silent machine, which is OUT then and may rejoin with its soil.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.map_updates import map_updates_after
from msg_bridge.contract.messages import (
    JoinRejected,
    Keyframe,
    MachineHeader,
    MachineReceipt,
    Message,
    RetransmitRequest,
    RowChunk,
    RowRange,
    SoilHeader,
    Stream,
    Verb,
)
from msg_bridge.contract.rows import (
    CONVERSION,
    FORCE,
    MAP_UPDATE,
    Rows,
    empty_rows,
    rows_of_machine,
)
from msg_bridge.exchange.join_handshake import JoinHandshake
from msg_bridge.exchange.machine_streams import MachineStreams
from msg_bridge.exchange.stream_buffers import PIPELINE_DEPTH
from msg_bridge.exchange.ticks_in_flight import TicksInFlight

__all__ = ["JoinState", "MachineExchange", "TickAnswer"]

_MAX_MACHINE_ID = 2**16 - 1


class JoinState(Enum):
    """State of a machine in the exchange."""

    OUT = "out"
    JOINING = "joining"
    READY = "ready"
    WAITING = "waiting"
    LEAVING = "leaving"


@dataclass(frozen=True)
class TickAnswer:
    """The soil's complete answer to a tick. The rows must not be modified.

    Attributes:
        tick: the soil's tick that answers; in real time it may be later than the tick sent.
        conversions: CONVERSION rows of this machine, in order.
        forces: FORCE rows of this machine.
        map_updates: MAP_UPDATE rows newer than the keyframe.
    """

    tick: int
    conversions: Rows
    forces: Rows
    map_updates: Rows


class MachineExchange:
    """The streams, acknowledgements and join state of one machine.

    Attributes:
        machine_id: number of the machine, from 1.
        run_id: number of the run in which it takes part.
        session_id: number of its latest session.
        join_state: state of the exchange.
        tick: the last tick answered by the soil, once joined.
        sent_tick: the last tick sent; before the first, the tick of the welcome.
        keyframe: the terrain at the welcome.
        backlog: CONVERSION rows published while it took no part, to apply before the first tick.
        rejection_reason: why the soil rejected the latest join; empty if it did not.
        dropped: whether the soil ended the session.
    """

    def __init__(self, machine_id: int, *, run_id: int = 1, session_id: int = 0) -> None:
        """
        Args:
            machine_id: number of the machine, from 1.
            run_id: number of the run in which to take part.
            session_id: a number below 2**32, not less than any that this machine has used in this
                run. A process that may be restarted takes a growing one, as the time in seconds.

        Raises:
            ExchangeError: ID_RANGE.
        """
        if not 1 <= machine_id <= _MAX_MACHINE_ID:
            raise ExchangeError(
                f"machine_id is {machine_id}; number machines from 1 to {_MAX_MACHINE_ID}",
                ErrorCode.ID_RANGE,
            )
        self.machine_id = machine_id
        self.run_id = run_id
        self.session_id = session_id
        self.join_state = JoinState.OUT
        self.tick = self.sent_tick = -1
        self._applied: int | None = None  # last conversion row applied; None before any welcome
        self._sent: MachineHeader | None = None
        self._leave_confirmation: SoilHeader | None = None  # the first header without this machine
        self._outbox: list[Message] = []
        self.keyframe: Keyframe | None = None
        self.backlog: Rows = empty_rows(CONVERSION)
        self._begin_session()

    @property
    def joined(self) -> bool:
        """Whether it takes part."""
        return self.join_state in (JoinState.READY, JoinState.WAITING, JoinState.LEAVING)

    @property
    def waiting(self) -> bool:
        """Whether the next tick can only be sent after an answer."""
        return self.join_state in (JoinState.WAITING, JoinState.LEAVING)

    @property
    def next_tick(self) -> int:
        """Number of the tick to send next; in real time missed numbers are skipped."""
        return max(self.tick, self.sent_tick) + 1

    @property
    def num_ticks_in_flight(self) -> int:
        """Number of ticks sent and not answered."""
        return len(self._in_flight)

    @property
    def is_missing_rows(self) -> bool:
        """Whether the awaited header is here and rows that it counts are not."""
        return self.join_state is JoinState.WAITING and self._in_flight.is_missing_rows

    @property
    def num_buffered_rows(self) -> int:
        """Number of rows in memory, sent and received."""
        received = self._in_flight.num_buffered_rows + self._handshake.num_buffered_rows
        return received + self._streams.num_buffered_rows

    def join(self, *, pending_mm3: int = 0, particles_mm3: int = 0) -> None:
        """Request to take part from the next tick on.

        A machine that took part before rejoins with the soil it holds and receives its backlog.

        Args:
            pending_mm3, particles_mm3: soil that it holds [mm^3], all answers applied.

        Raises:
            ExchangeError: JOIN_STATE: it takes part already.
        """
        if self.join_state is not JoinState.OUT:
            raise ExchangeError(
                f"machine {self.machine_id} is {self.join_state.value}; it can join when it is out",
                ErrorCode.JOIN_STATE,
            )
        self.session_id += 1
        self._begin_session()
        self._sent = MachineHeader(
            self.run_id,
            self.machine_id,
            self.session_id,
            self.tick,
            Verb.JOIN if self._applied is None else Verb.REJOIN,
            conversions_received=self._applied or 0,
            pending_mm3=pending_mm3,
            particles_mm3=particles_mm3,
        )
        self.join_state = JoinState.JOINING
        self._outbox.append(self._sent)

    def send(
        self,
        sweeps: Rows,
        deposit_requests: Rows,
        *,
        pending_mm3: int,
        particles_mm3: int,
        leave: bool = False,
    ) -> None:
        """Send the next tick.

        Args:
            sweeps: SWEEP rows.
            deposit_requests: DEPOSIT_REQUEST rows; each particle stays frozen until the soil
                answers with its conversion.
            pending_mm3, particles_mm3: soil that the machine holds at the end of the tick [mm^3],
                all answers so far applied.
            leave: whether this is the last tick of the session.

        Raises:
            ExchangeError: JOIN_STATE: not joined, or too many ticks are not answered.
        """
        if self.join_state is not JoinState.READY:
            raise ExchangeError(
                f"machine {self.machine_id} is {self.join_state.value}; it can send a tick when it"
                f" has joined and all but the last {PIPELINE_DEPTH} are answered",
                ErrorCode.JOIN_STATE,
            )
        assert self._applied is not None
        sweeps, sweep_range = self._streams.append(Stream.SWEEP, sweeps)
        deposit_requests, request_range = self._streams.append(
            Stream.DEPOSIT_REQUEST, deposit_requests
        )
        self._sent = MachineHeader(
            self.run_id,
            self.machine_id,
            self.session_id,
            self.next_tick,
            Verb.LEAVE if leave else Verb.STEP,
            sweep_range,
            request_range,
            self._applied,
            pending_mm3,
            particles_mm3,
            self.sent_tick,
        )
        self.sent_tick = self._sent.tick
        self._in_flight.add(self._sent)
        if leave:
            self.join_state = JoinState.LEAVING
        elif len(self._in_flight) > PIPELINE_DEPTH:
            self.join_state = JoinState.WAITING
        # The header comes last: over a transport that keeps the order its rows are there before it.
        self._outbox += self._streams.chunks(Stream.SWEEP, sweeps)
        self._outbox += self._streams.chunks(Stream.DEPOSIT_REQUEST, deposit_requests)
        self._outbox.append(self._sent)

    def receive(self, message: Message) -> None:
        """Process one message of the soil; those of other runs and sessions are ignored.

        Raises:
            ExchangeError: it violates the protocol; nothing was changed.
        """
        if message.run_id != self.run_id or self.join_state is JoinState.OUT:
            return
        is_joining = self.join_state is JoinState.JOINING
        if isinstance(message, SoilHeader):
            self._receive_header(message)
        elif isinstance(message, RowChunk):
            if is_joining and message.stream is Stream.BACKLOG and self._is_own(message):
                self._handshake.add_backlog(message.rows)
                self._begin_ticks()
            else:
                self._in_flight.add_rows(message)
        elif isinstance(message, Keyframe):
            if is_joining:
                self._handshake.add_keyframe(message)
                self._begin_ticks()
        elif isinstance(message, JoinRejected):
            if is_joining and self._is_own(message):
                self.rejection_reason = message.reason
                self.join_state = JoinState.OUT
        elif isinstance(message, RetransmitRequest) and self._is_own(message):
            if message.stream is Stream.HEADER:
                self._outbox += self._in_flight.sent_headers(message.first)
            else:
                self._outbox += self._streams.retransmit(message)

    def poll(self) -> TickAnswer | None:
        """Return the awaited answer once it is complete, else None."""
        if self.join_state is JoinState.LEAVING and self._leave_confirmation is not None:
            self.join_state = JoinState.OUT
            no_rows = (empty_rows(CONVERSION), empty_rows(FORCE), empty_rows(MAP_UPDATE))
            return TickAnswer(self._leave_confirmation.tick, *no_rows)
        answered = self._in_flight.pop() if self.join_state is JoinState.WAITING else None
        if answered is None:
            return None
        header, rows = answered.header, answered.rows
        assert self.keyframe is not None
        self._streams.discard_through(Stream.SWEEP, answered.sent.sweeps.last)
        receipt = self._receipt(header)
        if receipt is not None:
            self._streams.discard_through(Stream.DEPOSIT_REQUEST, receipt.deposit_requests_received)
        self.join_state = JoinState.READY
        self.tick = header.tick
        self._applied = header.conversions.last
        return TickAnswer(
            header.tick,
            rows_of_machine(rows[Stream.CONVERSION], self.machine_id),
            rows_of_machine(rows[Stream.FORCE], self.machine_id),
            map_updates_after(self.keyframe.revision, rows[Stream.MAP_UPDATE]),
        )

    def request_missing(self) -> None:
        """Request again what has not arrived.

        A machine that is slow with its next tick requests the latest header: this shows that it is
        alive, and that header shows whether the soil has dropped it.
        """
        if self._sent is None or self.join_state is JoinState.OUT:
            return
        if self.join_state is JoinState.JOINING:
            if self._handshake.welcome is None:
                self._outbox.append(self._sent)
                self._request(Stream.HEADER, RowRange(self._sent.tick, 1))
            else:
                for stream, span in self._handshake.missing():
                    self._request(stream, span)
            return
        unanswered = self._in_flight.unanswered_headers()
        # Either the soil lacks a part of the tick and requests it, or its header was lost.
        self._outbox += unanswered
        if unanswered or self.join_state is JoinState.READY:
            tick = unanswered[0].tick if unanswered else self.sent_tick
            self._request(Stream.HEADER, RowRange(tick, 1))
        for stream, span in self._in_flight.gaps():
            self._request(stream, span)

    def drain_outbox(self) -> list[Message]:
        """Return the messages to send to the soil, in order, and empty the outbox."""
        messages = self._outbox
        self._outbox = []
        return messages

    def _begin_session(self) -> None:
        """Reset all state of the session before; streams count from 1 in every session."""
        self._streams = MachineStreams(self.run_id, self.machine_id, self.session_id)
        self._in_flight = TicksInFlight()
        self._handshake = JoinHandshake()
        self._outbox = []
        self._leave_confirmation = None
        self.keyframe = None
        self.backlog = empty_rows(CONVERSION)
        self.rejection_reason = ""
        self.dropped = False

    def _receive_header(self, header: SoilHeader) -> None:
        assert self._sent is not None
        receipt = self._receipt(header)
        if self.join_state is JoinState.JOINING:
            if receipt is not None and self._handshake.welcome is None:
                self._handshake.set_welcome(header, receipt)
                self._in_flight.begin(header)
                self._begin_ticks()
        elif self.join_state is JoinState.LEAVING:
            if receipt is None and header.tick >= self._sent.tick:
                self._leave_confirmation = header
        elif header.tick > self.tick:
            if receipt is None:
                self.join_state = JoinState.OUT
                self.dropped = True
            else:
                self._in_flight.add_header(header, receipt)

    def _begin_ticks(self) -> None:
        """Take part, once everything that this requires has arrived."""
        handshake = self._handshake
        if not handshake.is_complete:
            return
        assert handshake.welcome is not None
        self.keyframe = handshake.keyframe
        self.backlog = handshake.backlog_rows()
        self.tick = self.sent_tick = handshake.welcome.tick
        self._applied = handshake.welcome.conversions.last
        self.join_state = JoinState.READY

    def _receipt(self, header: SoilHeader) -> MachineReceipt | None:
        return next((receipt for receipt in header.receipts if self._is_own(receipt)), None)

    def _is_own(
        self, message: MachineReceipt | RowChunk | RetransmitRequest | JoinRejected
    ) -> bool:
        """Return whether a message is of this machine and session."""
        return message.machine_id == self.machine_id and message.session_id == self.session_id

    def _request(self, stream: Stream, span: RowRange) -> None:
        ids = (self.run_id, self.machine_id, self.session_id)
        self._outbox.append(RetransmitRequest(*ids, stream, span.first, span.count))
