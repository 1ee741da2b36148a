"""The machine's end of the exchange, as a state machine without a clock or a network.

Messages go in by `receive` and come out by `drain_outbox`; `request_missing` is called by whoever carries
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
from msg_bridge.exchange.chunks import split_into_chunks
from msg_bridge.exchange.join_handshake import JoinHandshake
from msg_bridge.exchange.stream_buffers import PIPELINE_DEPTH, SendBuffer
from msg_bridge.exchange.ticks_in_flight import TicksInFlight

__all__ = ["JoinState", "MachineExchange", "TickAnswer"]


class JoinState(Enum):
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
    map_updates: Rows


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

    def __init__(self, machine_id: int, *, run_id: int = 1, session_id: int = 0) -> None:
        """
        Args:
            source: the machine's number, from 1.
            epoch: the run to take part in.
            life: a number below 2**32, not below any this source has used in this run; a process
                that may have been started again gives a larger one, the time in seconds say.
        """
        if not 1 <= machine_id <= 65535:
            raise ExchangeError(f"source is {machine_id}; number machines from 1 to 65535")
        self.machine_id = machine_id
        self.run_id = run_id
        self.session_id = session_id
        self.join_state = JoinState.OUT
        self.tick = self.sent_tick = -1
        self.keyframe: Keyframe | None = None
        self.backlog: Rows = empty_rows(CONVERSION)
        self.rejection_reason = ""
        self.dropped = False
        self._outbox: list[Message] = []
        self._applied: int | None = None  # last conversion row applied; None before any welcome
        self._sent: MachineHeader | None = None
        self._leave_confirmation: SoilHeader | None = None  # the first header that lists it no more
        self._begin_session()

    @property
    def joined(self) -> bool:
        """Whether it takes part."""
        return self.join_state in (JoinState.READY, JoinState.WAITING, JoinState.LEAVING)

    @property
    def waiting(self) -> bool:
        """Whether the next tick can only be sent once an answer has come in full."""
        return self.join_state in (JoinState.WAITING, JoinState.LEAVING)

    @property
    def next_tick(self) -> int:
        """Number of the tick to be sent next; in real time, those it missed are left out."""
        return max(self.tick, self.sent_tick) + 1

    @property
    def num_ticks_in_flight(self) -> int:
        """Number of ticks sent and not answered."""
        return len(self._in_flight)

    @property
    def num_buffered_rows(self) -> int:
        """Number of rows in memory, sent and received."""
        sent = self._sweeps.num_buffered_rows + self._landed.num_buffered_rows
        return sent + self._in_flight.num_buffered_rows + self._handshake.backlog.num_buffered_rows

    @property
    def is_missing_rows(self) -> bool:
        """Whether the header that is waited for is here and rows that it counts are not."""
        return self.join_state is JoinState.WAITING and self._in_flight.is_missing_rows

    def join(self, *, pending_mm3: int = 0, particles_mm3: int = 0) -> None:
        """Ask to take part from the next tick on.

        One that was here before and has applied all it was answered comes back with what it holds,
        and is sent the rows it is owed.

        Raises:
            ExchangeError: it takes part already.
        """
        if self.join_state is not JoinState.OUT:
            raise ExchangeError(
                f"machine {self.machine_id} is {self.join_state.value}; it can join once out"
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
            landed: LANDED rows; each particle stays frozen until its conversion comes.
            pending_mm3, particles_mm3: what the machine holds at the end of the tick, all
                conversions answered so far applied.
            leave: take no part after this tick.

        Raises:
            ExchangeError: not joined yet, or too many ticks are not answered yet.
        """
        if self.join_state is not JoinState.READY:
            raise ExchangeError(
                f"machine {self.machine_id} is {self.join_state.value}; a tick can be sent once it has"
                f" joined and all but the last {PIPELINE_DEPTH} are answered"
            )
        sweeps, sweep_range = self._sweeps.append(sweeps)
        deposit_requests, deposit_request_range = self._landed.append(deposit_requests)
        for rows in (sweeps, deposit_requests):
            if rows.size:
                rows["machine_id"] = self.machine_id
        assert self._applied is not None
        self._sent = MachineHeader(
            self.run_id,
            self.machine_id,
            self.session_id,
            self.next_tick,
            Verb.LEAVE if leave else Verb.STEP,
            sweep_range,
            deposit_request_range,
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
        # The header last: who has it can expect to have the rows.
        self._post(Stream.SWEEP, sweeps)
        self._post(Stream.DEPOSIT_REQUEST, deposit_requests)
        self._outbox.append(self._sent)

    def receive(self, message: Message) -> None:
        """Take one message from the soil; those of another epoch, source or life are ignored.

        Raises:
            ExchangeError: it breaks the exchange; nothing was changed.
        """
        if message.run_id != self.run_id or self.join_state is JoinState.OUT:
            return
        if isinstance(message, SoilHeader):
            self._receive_header(message)
        elif isinstance(message, RowChunk):
            mine = message.machine_id == self.machine_id and message.session_id == self.session_id
            if message.stream is Stream.BACKLOG and mine and self.join_state is JoinState.JOINING:
                self._handshake.backlog.add(message.rows)
                self._try_enter()
            else:
                self._in_flight.take_rows(message)
        elif isinstance(message, Keyframe):
            if self.join_state is JoinState.JOINING:
                self._handshake.take_keyframe(message)
                self._try_enter()
        elif isinstance(message, JoinRejected):
            if self.join_state is JoinState.JOINING and self._is_own(
                message.machine_id, message.session_id
            ):
                self.rejection_reason = message.reason
                self.join_state = JoinState.OUT
        elif isinstance(message, RetransmitRequest) and self._is_own(
            message.machine_id, message.session_id
        ):
            self._retransmit(message)

    def poll(self) -> TickAnswer | None:
        """The answer that is waited for, once all of it is here."""
        if self.join_state is JoinState.LEAVING and self._leave_confirmation is not None:
            self.join_state = JoinState.OUT
            nothing = (empty_rows(CONVERSION), empty_rows(FORCE), empty_rows(MAP_UPDATE))
            return TickAnswer(self._leave_confirmation.tick, *nothing)
        answered = self._in_flight.pop() if self.join_state is JoinState.WAITING else None
        if answered is None:
            return None
        header, rows = answered.header, answered.rows
        assert self.keyframe is not None
        self._sweeps.discard_through(answered.sent.sweeps.last)
        receipt = self._receipt(header)
        if receipt is not None:
            self._landed.discard_through(receipt.deposit_requests_received)
        self.join_state = JoinState.READY
        self.tick = header.tick
        self._applied = header.conversions.last
        return TickAnswer(
            header.tick,
            rows_of_machine(rows[Stream.CONVERSION], self.machine_id),
            rows_of_machine(rows[Stream.FORCE], self.machine_id),
            _updates_since(self.keyframe.revision, rows[Stream.MAP_UPDATE]),
        )

    def request_missing(self) -> None:
        """Ask again for what has not come.

        One that takes its time over its next tick asks where the run stands: a sign of life, and
        it learns whether the soil has gone on without it.
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
        waits = self._in_flight.unanswered_headers()
        # Either the soil lacks part of our tick, and asks for it, or we lack its header.
        self._outbox.extend(waits)
        if waits or self.join_state is JoinState.READY:
            self._request(Stream.HEADER, RowRange(waits[0].tick if waits else self.sent_tick, 1))
        for stream, span in self._in_flight.gaps():
            self._request(stream, span)

    def drain_outbox(self) -> list[Message]:
        """The messages to carry to the soil, in order; empties the box."""
        out = self._outbox
        self._outbox = []
        return out

    def _begin_session(self) -> None:
        """Streams of a life count from 1; nothing of an earlier life is left."""
        self._sweeps = SendBuffer(Stream.SWEEP)
        self._landed = SendBuffer(Stream.DEPOSIT_REQUEST)
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
                self._handshake.take_welcome(header, receipt)
                self._in_flight.begin(header)
                self._try_enter()
        elif self.join_state is JoinState.LEAVING:
            if receipt is None and header.tick >= self._sent.tick:
                self._leave_confirmation = header
        elif header.tick > self.tick:
            if receipt is None:
                self.join_state = JoinState.OUT
                self.dropped = True
            else:
                self._in_flight.take_header(header, receipt)

    def _try_enter(self) -> None:
        """Take part, once all that takes is here."""
        entry = self._handshake
        if not entry.is_complete:
            return
        assert entry.welcome is not None
        self.keyframe = entry.keyframe
        self.backlog = entry.backlog_rows()
        self.tick = self.sent_tick = entry.welcome.tick
        self._applied = entry.welcome.conversions.last
        self.join_state = JoinState.READY

    def _receipt(self, header: SoilHeader) -> MachineReceipt | None:
        for receipt in header.receipts:
            if self._is_own(receipt.machine_id, receipt.session_id):
                return receipt
        return None

    def _is_own(self, machine_id: int, session_id: int) -> bool:
        return machine_id == self.machine_id and session_id == self.session_id

    def _retransmit(self, request: RetransmitRequest) -> None:
        if request.stream is Stream.HEADER:
            self._outbox.extend(self._in_flight.sent(request.first))
        elif request.stream in (Stream.SWEEP, Stream.DEPOSIT_REQUEST):
            kept = self._sweeps if request.stream is Stream.SWEEP else self._landed
            self._post(request.stream, kept.kept_rows(RowRange(request.first, request.count)))

    def _request(self, stream: Stream, span: RowRange) -> None:
        request = RetransmitRequest(
            self.run_id, self.machine_id, self.session_id, stream, span.first, span.count
        )
        self._outbox.append(request)

    def _post(self, stream: Stream, rows: Rows) -> None:
        self._outbox.extend(
            split_into_chunks(
                self.run_id, stream, rows, machine_id=self.machine_id, session_id=self.session_id
            )
        )


def _updates_since(revision: int, map_updates: Rows) -> Rows:
    """CHANGED rows of revisions after one."""
    if map_updates.size == 0:
        return map_updates
    # Revisions in rows are modulo 2**32, as sequence numbers are: half of all others are later.
    beyond_next = map_updates["revision"] - np.uint32((revision + 1) % 2**32)
    later = beyond_next < 2**31 - 1
    return map_updates if np.count_nonzero(later) == map_updates.size else map_updates[later]
