"""The soil's state of one machine in one session."""

from __future__ import annotations

from collections import deque

from msg_bridge.contract.errors import ErrorCode, ExchangeError
from msg_bridge.contract.messages import (
    MachineHeader,
    MachineReceipt,
    Message,
    RetransmitRequest,
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
"""Largest volume that one machine may report [mm^3], 9 million m^3; sums remain int64."""

_MAX_LISTED_ROWS = 4
"""Maximum number of row numbers listed in an error message."""


class MachineSession:
    """One session of a joined machine: its rows, the headers of its next ticks, its backlog.

    Attributes:
        machine_id, session_id: the machine and its session.
        last_tick: the last of its ticks that was processed.
        backlog: CONVERSION rows published while the machine took no part, numbered from 1.
        num_backlog_rows: number of those rows; 0 once the machine has applied them.
    """

    def __init__(self, machine_id: int, session_id: int, backlog: Rows, tick: int) -> None:
        """Begin a session with the header of `tick`, which must be passed to `record_published`."""
        self.machine_id = machine_id
        self.session_id = session_id
        self.last_tick = self._first_tick = tick
        self.backlog = SendBuffer(Stream.BACKLOG)
        backlog_range = self.backlog.append(backlog).span
        self.num_backlog_rows = backlog_range.count
        self._backlog_digest = backlog_range.digest
        self._sweeps = ReceiveBuffer(Stream.SWEEP, machine_id=machine_id)
        self._deposit_requests = ReceiveBuffer(Stream.DEPOSIT_REQUEST, machine_id=machine_id)
        self._receive_buffers = {
            Stream.SWEEP: self._sweeps,
            Stream.DEPOSIT_REQUEST: self._deposit_requests,
        }
        # Headers of ticks that are not processed yet, the oldest first.
        self._pending_headers: deque[MachineHeader] = deque()
        # Published headers with the machine's tick processed before each, from the latest on that
        # the machine certainly has.
        self._published_headers: deque[tuple[int, SoilHeader]] = deque()
        self._recent_ticks = deque([self.last_tick], maxlen=PIPELINE_DEPTH + 2)  # processed last

    @property
    def header(self) -> MachineHeader | None:
        """Header of the next tick, None if it has not arrived."""
        return self._pending_headers[0] if self._pending_headers else None

    @property
    def acknowledged(self) -> dict[Stream, RowRange]:
        """Ranges of the soil's rows in the latest header that the machine has acknowledged."""
        return self._published_headers[0][1].spans

    @property
    def receipt(self) -> MachineReceipt:
        """Acknowledgement of what the soil has processed in this session.

        Rows that were received but not processed are not acknowledged: they may turn out not to be
        those of the machine, and must be sent again then.
        """
        return MachineReceipt(
            self.machine_id,
            self.session_id,
            self._deposit_requests.expected - 1,
            self.num_backlog_rows,
            self.last_tick,
            self._backlog_digest if self.num_backlog_rows else 0,
        )

    @property
    def num_buffered_rows(self) -> int:
        """Number of rows kept, received ones and the backlog."""
        received = sum(buffer.num_buffered_rows for buffer in self._receive_buffers.values())
        return received + self.backlog.num_buffered_rows

    def expects(self, header: MachineHeader) -> bool:
        """Return whether a header is that of the machine's next tick.

        A duplicate is not; nor is a header that overtook the one before it, which is requested
        again later.
        """
        newest = self._pending_headers[-1].tick if self._pending_headers else self.last_tick
        is_next = header.tick > newest and header.previous_tick == newest
        return is_next and len(self._pending_headers) <= PIPELINE_DEPTH

    def check_header(self, header: MachineHeader) -> None:
        """Check the header of the machine's next tick, which the session expects.

        Raises:
            ExchangeError: ROW_RANGE, VOLUME_RANGE or ACKNOWLEDGEMENT.
        """
        before = self._pending_headers[-1] if self._pending_headers else None
        if before is None:
            sweep, request = self._sweeps.expected, self._deposit_requests.expected
        else:
            sweep, request = before.sweeps.last + 1, before.deposit_requests.last + 1
        check_row_range(header.sweeps, Stream.SWEEP, sweep)
        check_row_range(header.deposit_requests, Stream.DEPOSIT_REQUEST, request)
        self._check_volumes(header)
        self._check_acknowledgement(header)

    def add_header(self, header: MachineHeader) -> None:
        """Add the header of the machine's next tick, which was checked."""
        self._pending_headers.append(header)

    def receive_rows(self, chunk: RowChunk) -> bool:
        """Add rows of the machine; return whether there are new ones.

        Raises:
            ExchangeError: STREAM_DIRECTION, SENDER_MISMATCH, ROW_TYPE or SEQUENCE_NUMBER; nothing
                was changed.
        """
        buffer = self._receive_buffers.get(chunk.stream)
        if buffer is None:
            raise ExchangeError(
                f"machines do not send {chunk.stream.name} rows", ErrorCode.STREAM_DIRECTION
            )
        return buffer.add(chunk.rows, chunk.sent) > 0

    def can_send(self, message: MachineHeader | RetransmitRequest) -> bool:
        """Return whether the machine can send a message of this session now.

        A machine repeats only ticks that may not be answered yet, and requests only what it may not
        have. Other publishers can send any of its messages again.
        """
        if self.last_tick == self._first_tick:  # it may not have its welcome yet
            return True
        # Of older ticks the machine has the answer.
        oldest_unanswered = self._recent_ticks[-(PIPELINE_DEPTH + 1)]
        if isinstance(message, MachineHeader):
            return message.is_tick and message.tick >= oldest_unanswered
        if message.stream is Stream.HEADER:
            return message.first >= oldest_unanswered
        acknowledged = self.acknowledged.get(message.stream)
        last = message.first + message.count - 1
        return acknowledged is not None and last > acknowledged.last

    def gaps(self) -> list[tuple[Stream, RowRange]]:
        """Return the ranges of rows that the header counts and that have not arrived."""
        header = self.header
        assert header is not None
        return [(Stream.SWEEP, gap) for gap in self._sweeps.missing(header.sweeps)] + [
            (Stream.DEPOSIT_REQUEST, gap)
            for gap in self._deposit_requests.missing(header.deposit_requests)
        ]

    def is_complete(self) -> bool:
        """Return whether the header of the next tick and all rows that it counts are here."""
        header = self.header
        return header is not None and not (
            self._sweeps.missing(header.sweeps)
            or self._deposit_requests.missing(header.deposit_requests)
        )

    def discard_unprocessed(self) -> None:
        """Discard the rows and headers that are not processed yet, so that they are requested
        again: one of them is invalid, and it is unknown which."""
        self._pending_headers.clear()
        self._sweeps.clear()
        self._deposit_requests.clear()

    def tick_rows(self) -> tuple[Rows, Rows]:
        """Return the SWEEP and the DEPOSIT_REQUEST rows of a complete tick.

        Raises:
            ExchangeError: ROW_DIGEST: they are not those that its header states.
        """
        header = self.header
        assert header is not None
        sweeps = self._sweeps.checked_rows(header.sweeps)
        return sweeps, self._deposit_requests.checked_rows(header.deposit_requests)

    def tick_messages(self) -> list[Message]:
        """Return the messages of a complete tick: its rows, then its header."""
        header = self.header
        assert header is not None
        spans = {
            Stream.SWEEP: header.sweeps,
            Stream.DEPOSIT_REQUEST: header.deposit_requests,
        }
        chunks: list[Message] = [
            RowChunk(
                header.run_id,
                stream,
                self.machine_id,
                self.session_id,
                self._receive_buffers[stream].rows(span),
            )
            for stream, span in spans.items()
            if span.count
        ]
        return [*chunks, header]

    def complete_tick(self) -> MachineHeader:
        """Discard the rows and the header of a tick that was processed; return the header."""
        header = self._pending_headers.popleft()
        self._sweeps.discard_through(header.sweeps.last)
        self._deposit_requests.discard_through(header.deposit_requests.last)
        if self.num_backlog_rows:
            self.backlog.discard_through(self.num_backlog_rows)
            self.num_backlog_rows = 0
        self.last_tick = header.tick
        self._recent_ticks.append(header.tick)
        return header

    def record_published(self, header: SoilHeader) -> None:
        """Record a published header, and discard those before the latest that the machine has.

        A machine sends a tick after it has the answer to the one PIPELINE_DEPTH + 1 before.
        """
        self._published_headers.append((self.last_tick, header))
        certain = (
            self._recent_ticks[0]
            if len(self._recent_ticks) == PIPELINE_DEPTH + 2
            else self._published_headers[0][0]
        )
        while self._published_headers[0][0] < certain:
            self._published_headers.popleft()

    def _check_volumes(self, header: MachineHeader) -> None:
        volumes = (header.pending_mm3, header.particles_mm3)
        if min(volumes) < 0 or max(volumes) > _MAX_REPORTED_VOLUME:
            raise ExchangeError(
                f"machine {self.machine_id} reports {volumes[0]} + {volumes[1]} mm^3 of soil; each"
                f" must be from 0 to {_MAX_REPORTED_VOLUME}",
                ErrorCode.VOLUME_RANGE,
            )

    def _check_acknowledgement(self, header: MachineHeader) -> None:
        for _, answer in self._published_headers:
            if answer.conversions.last == header.conversions_received:
                return
        published = [answer.conversions.last for _, answer in self._published_headers]
        raise ExchangeError(
            f"machine {self.machine_id} acknowledges conversion row"
            f" {header.conversions_received}; the answers that it can have end with rows"
            f" {', '.join(map(str, published[-_MAX_LISTED_ROWS:]))}",
            ErrorCode.ACKNOWLEDGEMENT,
        )
