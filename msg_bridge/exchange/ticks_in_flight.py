"""Ticks that a machine has sent and that are not answered, and the answers received so far."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.messages import (
    MachineHeader,
    MachineReceipt,
    RowChunk,
    RowRange,
    SoilHeader,
    Stream,
)
from msg_bridge.contract.rows import Rows
from msg_bridge.exchange.stream_buffers import ReceiveBuffer, check_row_range

__all__ = ["CompletedTick", "TicksInFlight"]


_MAX_FAILED_REPAIRS = 32
"""Number of requests for a tick that was sent, and of rejected answers, without a valid answer in
between, after which the session is desynchronized; 8 s at the usual four requests a second, longer
than a flood of rows."""


@dataclass
class _Tick:
    """Header of a tick that was sent, and its newest answer so far; None without one."""

    sent: MachineHeader
    answer: SoilHeader | None = None


class CompletedTick(NamedTuple):
    """A tick with its complete answer.

    Attributes:
        sent: the machine's header.
        header: the soil's header that answers it.
        rows: all rows of the soil since the answer before, by stream.
    """

    sent: MachineHeader
    header: SoilHeader
    rows: dict[Stream, Rows]


class TicksInFlight:
    """Ticks sent, the oldest first, and the soil's rows that answer them.

    A soil that waits answers each tick in the header of the same number. One that does not wait may
    answer in a later header, together with the rows of all ticks in between.
    """

    def __init__(self) -> None:
        self._ticks: deque[_Tick] = deque()
        self._last_answer_tick = -1  # number of the last completed answer
        self._receive_buffers: dict[Stream, ReceiveBuffer] = {}
        self._num_failed_repairs = 0  # since the last completed answer
        # The oldest tick with its rows, from `oldest_completed` until its answer changes.
        self._completed: CompletedTick | None = None

    def __len__(self) -> int:
        return len(self._ticks)

    @property
    def is_desynchronized(self) -> bool:
        """Whether what is sent again does not help: see `MachineExchange.is_desynchronized`."""
        return self._num_failed_repairs >= _MAX_FAILED_REPAIRS

    @property
    def num_buffered_rows(self) -> int:
        """Number of the soil's rows kept."""
        return sum(buffer.num_buffered_rows for buffer in self._receive_buffers.values())

    @property
    def is_missing_rows(self) -> bool:
        """Whether rows that the answer to the oldest tick counts have not arrived."""
        answer = self._ticks[0].answer if self._ticks else None
        return answer is not None and bool(self._missing(self._spans(answer)))

    def begin(self, welcome: SoilHeader) -> None:
        """Begin to receive rows: those after the header that admits the machine."""
        self._last_answer_tick = welcome.tick
        self._completed = None
        self._receive_buffers = {
            stream: ReceiveBuffer(stream, span.last + 1) for stream, span in welcome.spans.items()
        }

    def add(self, sent: MachineHeader) -> None:
        """Add a tick that was sent."""
        self._ticks.append(_Tick(sent))

    def retransmit(self, first: int) -> list[MachineHeader]:
        """Return the headers, which the soil requests, of unfinished ticks from `first` on."""
        sent = [tick.sent for tick in self._ticks if tick.sent.tick >= first]
        self._num_failed_repairs += bool(sent)
        return sent

    def add_rows(self, chunk: RowChunk) -> None:
        """Add rows that the soil sends to all; before `begin` they are ignored.

        Raises:
            ExchangeError: ROW_TYPE or SEQUENCE_NUMBER.
        """
        if chunk.stream in self._receive_buffers and chunk.machine_id == 0:
            self._receive_buffers[chunk.stream].add(chunk.rows, chunk.sent)

    def add_header(self, header: SoilHeader, receipt: MachineReceipt) -> None:
        """Add a header if it answers a tick in flight; it replaces older answers to the tick.

        Raises:
            ExchangeError: ROW_RANGE; nothing was changed.
        """
        for k, tick in enumerate(self._ticks):
            if tick.sent.tick != receipt.tick:
                continue
            if tick.answer is not None and tick.answer.tick >= header.tick:
                return
            before = self._ticks[k - 1].answer if k else None
            try:
                self._check_row_ranges(header, before)
            except ExchangeError:
                self._num_failed_repairs += 1
                raise
            tick.answer = header
            self._completed = None
            if header.tick > receipt.tick:
                # The soil does not wait: it may have discarded its answers to older ticks.
                for older in list(self._ticks)[:k]:
                    older.answer = older.answer or header

    def oldest_completed(self) -> CompletedTick | None:
        """Return the oldest tick if its answer has arrived with all rows; else None."""
        if self._completed is not None:
            return self._completed
        answer = self._ticks[0].answer if self._ticks else None
        if answer is None:
            return None
        rows = {}
        for stream, span in answer.spans.items():
            received = self._receive_buffers[stream].rows_through(span.last)
            if received is None:
                return None
            rows[stream] = received
        self._completed = CompletedTick(self._ticks[0].sent, answer, rows)
        return self._completed

    def check_row_digests(self, completed: CompletedTick) -> None:
        """Check the rows of a completed tick against the header that answers it.

        Rows of ticks that the machine skipped are not checked: it may lack their headers.

        Raises:
            ExchangeError: ROW_DIGEST. Rows and answer are discarded: it is unknown which of them
                are right.
        """
        header = completed.header
        if header.tick == self._last_answer_tick:  # it answered the tick before, too
            return
        try:
            for stream, span in header.spans.items():
                self._receive_buffers[stream].checked_rows(span)
        except ExchangeError:
            self.discard_answer()
            raise

    def remove_completed(self) -> None:
        """Remove the oldest tick, which is completed, with the rows of its answer."""
        answer = self._ticks.popleft().answer
        assert answer is not None
        for stream, span in answer.spans.items():
            buffer, last = self._receive_buffers[stream], span.last
            if last >= buffer.expected:
                buffer.discard_through(last)
        self._last_answer_tick = answer.tick
        self._num_failed_repairs = 0
        self._completed = None

    def discard_answer(self) -> None:
        """Discard the answer to the oldest tick, and all rows received, so that they are requested
        again."""
        self._ticks[0].answer = None
        self._completed = None
        self._num_failed_repairs += 1
        for buffer in self._receive_buffers.values():
            buffer.clear()

    def discard_received(self) -> None:
        """Discard all answers and rows that are not processed yet."""
        for tick in self._ticks:
            tick.answer = None
        self._completed = None
        for buffer in self._receive_buffers.values():
            buffer.clear()

    def gaps(self) -> list[tuple[Stream, RowRange]]:
        """Return the ranges of rows that the newest answer counts and that have not arrived."""
        newest = max(
            (tick.answer for tick in self._ticks if tick.answer is not None),
            key=lambda answer: answer.tick,
            default=None,
        )
        return [] if newest is None else self._missing(self._spans(newest))

    def unanswered_headers(self) -> list[MachineHeader]:
        """Return the headers of ticks without an answer."""
        return [tick.sent for tick in self._ticks if tick.answer is None]

    def _check_row_ranges(self, header: SoilHeader, before: SoilHeader | None) -> None:
        """Check that a header continues the one before, or the last completed one.

        Raises:
            ExchangeError: ROW_RANGE.
        """
        tick_before = self._last_answer_tick if before is None else before.tick
        allow_gap = header.tick != tick_before + 1
        for stream, span in header.spans.items():
            expected = (
                self._receive_buffers[stream].expected
                if before is None
                else before.spans[stream].last + 1
            )
            if span.first != expected or span.count:
                check_row_range(span, stream, expected, allow_gap=allow_gap)

    def _missing(self, spans: dict[Stream, RowRange]) -> list[tuple[Stream, RowRange]]:
        return [
            (stream, gap)
            for stream, span in spans.items()
            for gap in self._receive_buffers[stream].missing(span)
        ]

    def _spans(self, answer: SoilHeader) -> dict[Stream, RowRange]:
        """Return the ranges from the last completed answer up to the end of this one."""
        spans = {}
        for stream, span in answer.spans.items():
            first = self._receive_buffers[stream].expected
            if span.first != first:  # rows of answers in between are included
                span = RowRange(first, span.last + 1 - first)
            spans[stream] = span
        return spans
