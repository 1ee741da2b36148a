"""What a machine has sent and has not been answered yet, and what has come of the answers."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

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


@dataclass
class _Tick:
    sent: MachineHeader
    answer: SoilHeader | None = None


@dataclass(frozen=True)
class CompletedTick:
    """A tick whose answer is here in full.

    Attributes:
        sent: the machine's word on it.
        header: the soil's.
        rows: all that the soil has moved since the answer before, by stream.
    """

    sent: MachineHeader
    header: SoilHeader
    rows: dict[Stream, Rows]


class TicksInFlight:
    """Ticks sent, the oldest first, and the soil's rows that answer them.

    A soil that waits answers each tick in the header of the same number. One that does not wait may
    answer in a later one, which counts the rows of all ticks since, too.
    """

    def __init__(self) -> None:
        self._ticks: deque[_Tick] = deque()
        self._last_answer_tick = -1  # number of the answer taken last
        self._receive_buffers: dict[Stream, ReceiveBuffer] = {}

    def begin(self, welcome: SoilHeader) -> None:
        """Count rows from those on that come after the header that lets the machine take part."""
        self._last_answer_tick = welcome.tick
        self._receive_buffers = {
            stream: ReceiveBuffer(stream, span.last + 1) for stream, span in welcome.spans.items()
        }

    def __len__(self) -> int:
        return len(self._ticks)

    @property
    def num_buffered_rows(self) -> int:
        """Number of the soil's rows kept."""
        return sum(buffer.num_buffered_rows for buffer in self._receive_buffers.values())

    @property
    def is_missing_rows(self) -> bool:
        """Whether the answer to the oldest is here, but for rows that it counts."""
        answer = self._ticks[0].answer if self._ticks else None
        return answer is not None and bool(self._missing(self._spans(answer)))

    def add(self, sent: MachineHeader) -> None:
        """Note that a tick was sent."""
        self._ticks.append(_Tick(sent))

    def sent(self, first: int) -> list[MachineHeader]:
        """Those not answered yet, from a number on."""
        return [tick.sent for tick in self._ticks if tick.sent.tick >= first]

    def take_rows(self, chunk: RowChunk) -> None:
        """Take rows of the soil; before it has begun, none are needed.

        Raises:
            ExchangeError: of another type, or numbered far beyond any gap.
        """
        if chunk.stream in self._receive_buffers and chunk.machine_id == 0:
            self._receive_buffers[chunk.stream].add(chunk.rows)

    def take_header(self, header: SoilHeader, receipt: MachineReceipt) -> None:
        """Take a header, if it answers a tick sent; the newest that does so counts.

        Raises:
            ExchangeError: it counts its rows wrongly; nothing was changed.
        """
        for k, tick in enumerate(self._ticks):
            if tick.sent.tick != receipt.tick:
                continue
            if tick.answer is not None and tick.answer.tick >= header.tick:
                return
            before = self._ticks[k - 1].answer if k else None
            number = self._last_answer_tick if before is None else before.tick
            for stream, span in header.spans.items():
                expected = (
                    self._receive_buffers[stream].expected
                    if before is None
                    else before.spans[stream].last + 1
                )
                skipping = header.tick != number + 1
                check_row_range(span, stream, expected, skipping=skipping)
            tick.answer = header
            if header.tick > receipt.tick:
                # It does not wait, and has gone on: its answer to an older tick may be long gone.
                for older in list(self._ticks)[:k]:
                    older.answer = older.answer or header

    def pop(self) -> CompletedTick | None:
        """The oldest tick, once its answer and all rows that it counts are here."""
        answer = self._ticks[0].answer if self._ticks else None
        if answer is None:
            return None
        spans = self._spans(answer)
        if self._missing(spans):
            return None
        rows = {}
        for stream, span in spans.items():
            rows[stream] = self._receive_buffers[stream].rows(span)
            self._receive_buffers[stream].discard_through(span.last)
        self._last_answer_tick = answer.tick
        return CompletedTick(self._ticks.popleft().sent, answer, rows)

    def gaps(self) -> list[tuple[Stream, RowRange]]:
        """Rows that answers count and that are not here."""
        newest = max(
            (tick.answer for tick in self._ticks if tick.answer is not None),
            key=lambda answer: answer.tick,
            default=None,
        )
        return [] if newest is None else self._missing(self._spans(newest))

    def unanswered_headers(self) -> list[MachineHeader]:
        """The machine's own words that no header of the soil has answered."""
        return [tick.sent for tick in self._ticks if tick.answer is None]

    def _missing(self, spans: dict[Stream, RowRange]) -> list[tuple[Stream, RowRange]]:
        return [
            (stream, gap)
            for stream, span in spans.items()
            for gap in self._receive_buffers[stream].missing(span)
        ]

    def _spans(self, answer: SoilHeader) -> dict[Stream, RowRange]:
        """Rows since the answer taken last, through those that `answer` counts."""
        spans = {}
        for stream, span in answer.spans.items():
            since = self._receive_buffers[stream].expected
            if span.first != since:  # there were answers in between
                span = RowRange(since, span.last + 1 - since)
            spans[stream] = span
        return spans
