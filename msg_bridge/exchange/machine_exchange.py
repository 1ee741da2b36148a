"""The machine's end of the exchange, as a state machine without clock and network.

Messages go in through `receive` and come out of `drain_outbox`. The owner calls `request_missing`
when there has been no progress for a while; it requests again what has not arrived. `JoinState`
draws the states.

A machine does not wait for the answer to the tick it has just sent, but for the one before
(`PIPELINE_DEPTH`), so that soil and machine compute at the same time. A leaving machine receives no
further rows: what the soil moved for it in its last ticks is its backlog, which it receives when it
rejoins. A soil that does not wait (real time) may answer a tick late, in the header whose receipt
names the tick. It may drop a silent machine, which is OUT then and may rejoin with its soil.
"""

from __future__ import annotations

from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.messages import (
    JoinRejected,
    Keyframe,
    MachineHeader,
    Message,
    RetransmitRequest,
    RowChunk,
    RowRange,
    SoilHeader,
    Stream,
    Verb,
)
from msg_bridge.contract.rows import CONVERSION, Rows, empty_rows
from msg_bridge.exchange.join_handshake import JoinHandshake
from msg_bridge.exchange.join_state import JoinState
from msg_bridge.exchange.machine_streams import MachineStreams
from msg_bridge.exchange.session_key import MAX_SESSION_ID, SessionKey
from msg_bridge.exchange.stream_buffers import PIPELINE_DEPTH
from msg_bridge.exchange.tick_answer import TickAnswer
from msg_bridge.exchange.ticks_in_flight import CompletedTick, TicksInFlight

__all__ = ["MachineExchange"]


class MachineExchange:
    """The streams, acknowledgements and join state of one machine.

    Attributes:
        machine_id: number of the machine, from 1.
        run_id: number of the run in which it takes part.
        session_id: number of its latest session.
        join_state: state of the exchange.
        tick: the last tick answered by the soil, once joined.
        sent_tick: the last tick sent; before the first, the tick of the welcome.
        last_sent: the last tick, or request to join, that was sent; None before the first.
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
            session_id: number from which sessions count; of a node `random_session_id`.

        Raises:
            ExchangeError: ID_RANGE.
        """
        SessionKey(run_id, machine_id, session_id or 1).check()
        self.machine_id = machine_id
        self.run_id, self.session_id = run_id, session_id
        self.join_state = JoinState.OUT
        self.tick = self.sent_tick = -1
        self._applied: int | None = None  # last conversion row applied; None before any welcome
        self.last_sent: MachineHeader | None = None
        self._leave_confirmation: SoilHeader | None = None  # the first header without this machine
        self._outbox: list[Message] = []
        self.keyframe: Keyframe | None = None
        self.backlog: Rows = empty_rows(CONVERSION)
        self._begin_session()

    @property
    def welcome_messages(self) -> list[Message]:
        """The messages with which the present session began: header, backlog and terrain."""
        return self._handshake.messages(self._key)

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
    def is_desynchronized(self) -> bool:
        """Whether soil and machine count rows differently: each rejects what the other sends."""
        return self._in_flight.is_desynchronized

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

        A machine that took part before rejoins with its soil and receives its backlog.

        Args:
            pending_mm3, particles_mm3: soil that it holds [mm^3], all answers applied.

        Raises:
            ExchangeError: JOIN_STATE: it takes part already.
        """
        self._check_out("it can join when it is out")
        self.session_id = self.session_id % MAX_SESSION_ID + 1
        self._begin_session()
        self.last_sent = MachineHeader(
            *self._key,
            self.tick,
            Verb.JOIN if self._applied is None else Verb.REJOIN,
            conversions_received=self._applied or 0,
            pending_mm3=pending_mm3,
            particles_mm3=particles_mm3,
        )
        self.join_state = JoinState.JOINING
        self._outbox.append(self.last_sent)

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
                f"machine {self.machine_id} is {self.join_state.value}; it can send when all ticks"
                f" but the last {PIPELINE_DEPTH} are answered",
                ErrorCode.JOIN_STATE,
            )
        assert self._applied is not None
        sent_sweeps, sent_requests, chunks = self._streams.append_tick(sweeps, deposit_requests)
        self.last_sent = MachineHeader(
            *self._key,
            self.next_tick,
            Verb.LEAVE if leave else Verb.STEP,
            sent_sweeps,
            sent_requests,
            self._applied,
            pending_mm3,
            particles_mm3,
            self.sent_tick,
            self.tick,
        )
        self.sent_tick = self.last_sent.tick
        self._in_flight.add(self.last_sent)
        if leave:
            self.join_state = JoinState.LEAVING
        elif len(self._in_flight) > PIPELINE_DEPTH:
            self.join_state = JoinState.WAITING
        # The header comes last: over a transport that keeps the order its rows are there before it.
        self._outbox += [*chunks, self.last_sent]

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
            if is_joining and message.stream is Stream.BACKLOG and self._key.matches(message):
                self._handshake.add_backlog(message.rows)
                self._begin_ticks()
            else:
                self._in_flight.add_rows(message)
        elif isinstance(message, Keyframe):
            if is_joining:
                self._handshake.add_keyframe(message)
                self._begin_ticks()
        elif isinstance(message, JoinRejected):
            if is_joining and self._key.matches(message):
                self.rejection_reason = message.reason
                self.join_state = JoinState.OUT
        elif isinstance(message, RetransmitRequest) and self._key.matches(message):
            if message.stream is Stream.HEADER:
                self._outbox += self._in_flight.retransmit(message.first)
            else:
                self._outbox += self._streams.retransmit(message)

    def poll(self) -> TickAnswer | None:
        """Return the awaited answer once it is complete, else None.

        It is returned until `acknowledge_answer` or `discard_answer` is called.

        Raises:
            ExchangeError: ROW_DIGEST: its rows are not those that its header states. It was
                discarded, and `request_missing` requests it again.
        """
        if self.join_state is JoinState.LEAVING and self._leave_confirmation is not None:
            return TickAnswer.without_rows(self._leave_confirmation)
        if self.join_state is not JoinState.WAITING:
            return None
        completed = self._in_flight.oldest_completed()
        if completed is None:
            return None
        self._in_flight.check_row_digests(completed)
        assert self.keyframe is not None
        return TickAnswer.for_machine(completed, self.machine_id, self.keyframe.revision)

    def discard_unprocessed(self) -> None:
        """Discard what the soil has sent of later ticks; it is requested again."""
        self._in_flight.discard_received()

    def acknowledge_answer(self) -> None:
        """Acknowledge the answer that `poll` returns; not before it was applied, which may fail.

        Raises:
            ExchangeError: JOIN_STATE: there is no complete answer.
        """
        if self.join_state is JoinState.LEAVING and self._leave_confirmation is not None:
            self.join_state = JoinState.OUT
            return
        completed = self._completed_tick()
        header = completed.header
        self._streams.discard_answered(completed.sent, self._key.receipt(header))
        self._in_flight.remove_completed()
        self.join_state = JoinState.READY
        self.tick = header.tick
        self._applied = header.conversions.last

    def discard_answer(self) -> None:
        """Discard the answer that `poll` returns, because it is invalid.

        Raises:
            ExchangeError: JOIN_STATE: there is no complete answer.
        """
        self._completed_tick()
        self._in_flight.discard_answer()

    def discard_welcome(self) -> None:
        """Discard terrain and backlog, because they are invalid; request them again.

        Raises:
            ExchangeError: JOIN_STATE: it has not just joined.
        """
        if self.join_state is not JoinState.READY or self.sent_tick != self.tick:
            raise ExchangeError(
                f"machine {self.machine_id} is {self.join_state.value}; its terrain is in use",
                ErrorCode.JOIN_STATE,
            )
        self._handshake.discard_content()
        self.join_state = JoinState.JOINING

    def abandon_session(self, applied: int | None = None) -> None:
        """End a session that cannot continue; the machine can rejoin with the soil it holds.

        Args:
            applied: last conversion row in that soil; None: that of the last answer.
        """
        self._applied = self._applied if applied is None else applied
        self.join_state = JoinState.OUT
        self.dropped = True

    def discard_soil(self) -> None:
        """Let the next join be one of a machine without soil.

        Raises:
            ExchangeError: JOIN_STATE: it takes part.
        """
        self._check_out("end its session first")
        self._applied = None

    def request_missing(self) -> None:
        """Request what has not arrived; if nothing, the latest header, to see whether the machine
        was dropped and to show that it is alive."""
        if self.last_sent is None or self.join_state is JoinState.OUT:
            return
        is_joining = self.join_state is JoinState.JOINING
        unanswered = self._in_flight.unanswered_headers()
        if is_joining and self._handshake.welcome is None:
            unanswered = [self.last_sent]
        self._outbox += unanswered
        if unanswered or self.join_state is JoinState.READY:
            tick = unanswered[0].tick if unanswered else self.sent_tick
            self._outbox.append(self._key.request(Stream.HEADER, RowRange(tick, 1)))
        missing = self._handshake.missing() if is_joining else self._in_flight.gaps()
        self._outbox += [self._key.request(stream, span) for stream, span in missing]

    def drain_outbox(self) -> list[Message]:
        """Return the messages to send to the soil, in order, and empty the outbox."""
        messages = self._outbox
        self._outbox = []
        return messages

    def _check_out(self, remedy: str) -> None:
        if self.join_state is not JoinState.OUT:
            raise ExchangeError(
                f"machine {self.machine_id} is {self.join_state.value}; {remedy}",
                ErrorCode.JOIN_STATE,
            )

    def _completed_tick(self) -> CompletedTick:
        """Return the tick whose answer is complete.

        Raises:
            ExchangeError: JOIN_STATE: there is none.
        """
        is_waiting = self.join_state is JoinState.WAITING
        completed = self._in_flight.oldest_completed() if is_waiting else None
        if completed is None:
            raise ExchangeError(
                f"machine {self.machine_id} has no complete answer; poll until there is one",
                ErrorCode.JOIN_STATE,
            )
        return completed

    def _begin_session(self) -> None:
        """Reset all state of the session before; streams count from 1 in every session."""
        self._key = SessionKey(self.run_id, self.machine_id, self.session_id)
        self._streams = MachineStreams(self._key)
        self._in_flight = TicksInFlight()
        self._handshake = JoinHandshake()
        self._outbox = []
        self._leave_confirmation = None
        self.keyframe = None
        self.backlog = empty_rows(CONVERSION)
        self.rejection_reason = ""
        self.dropped = False

    def _receive_header(self, header: SoilHeader) -> None:
        assert self.last_sent is not None
        receipt = self._key.receipt(header)
        if self.join_state is JoinState.JOINING:
            if receipt is not None and self._handshake.welcome is None:
                self._handshake.set_welcome(header, receipt)
                self._in_flight.begin(header)
                self._begin_ticks()
        elif self.join_state is JoinState.LEAVING:
            if receipt is None and header.tick >= self.last_sent.tick:
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
