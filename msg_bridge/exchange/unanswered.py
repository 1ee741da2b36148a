"""What a machine has sent and has not been answered yet, and what has come of the answers."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from msg_bridge.contract.messages import (
    MachineHeader,
    RowChunk,
    RowRange,
    SoilHeader,
    SourceReceipt,
    Stream,
)
from msg_bridge.contract.rows import Rows
from msg_bridge.exchange.streams import Incoming, check_span

__all__ = ["Answered", "Unanswered"]


@dataclass
class _Tick:
    sent: MachineHeader
    answer: SoilHeader | None = None


@dataclass(frozen=True)
class Answered:
    """A tick whose answer is here in full.

    Attributes:
        sent: the machine's word on it.
        header: the soil's.
        rows: all that the soil has moved since the answer before, by stream.
    """

    sent: MachineHeader
    header: SoilHeader
    rows: dict[Stream, Rows]


class Unanswered:
    """Ticks sent, the oldest first, and the soil's rows that answer them.

    A soil that waits answers each tick in the header of the same number. One that does not wait may
    answer in a later one, which counts the rows of all ticks since, too.
    """

    def __init__(self) -> None:
        self._ticks: deque[_Tick] = deque()
        self._before = -1  # number of the answer taken last
        self._incoming: dict[Stream, Incoming] = {}

    def begin(self, welcome: SoilHeader) -> None:
        """Count rows from those on that come after the header that lets the machine take part."""
        self._before = welcome.tick
        self._incoming = {
            stream: Incoming(stream, span.last + 1) for stream, span in welcome.spans.items()
        }

    def __len__(self) -> int:
        return len(self._ticks)

    @property
    def lacks_rows(self) -> bool:
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
        if chunk.stream in self._incoming and chunk.source == 0:
            self._incoming[chunk.stream].add(chunk.rows)

    def take_header(self, header: SoilHeader, receipt: SourceReceipt) -> None:
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
            number = self._before if before is None else before.tick
            for stream, span in header.spans.items():
                expected = (
                    self._incoming[stream].expected
                    if before is None
                    else before.spans[stream].last + 1
                )
                skipping = header.tick != number + 1
                check_span(span, stream, expected, skipping=skipping)
            tick.answer = header
            if header.tick > receipt.tick:
                # It does not wait, and has gone on: its answer to an older tick may be long gone.
                for older in list(self._ticks)[:k]:
                    older.answer = older.answer or header

    def pop(self) -> Answered | None:
        """The oldest tick, once its answer and all rows that it counts are here."""
        answer = self._ticks[0].answer if self._ticks else None
        if answer is None:
            return None
        spans = self._spans(answer)
        if self._missing(spans):
            return None
        rows = {}
        for stream, span in spans.items():
            rows[stream] = self._incoming[stream].rows(span)
            self._incoming[stream].forget(span.last)
        self._before = answer.tick
        return Answered(self._ticks.popleft().sent, answer, rows)

    def gaps(self) -> list[tuple[Stream, RowRange]]:
        """Rows that answers count and that are not here."""
        newest = max(
            (tick.answer for tick in self._ticks if tick.answer is not None),
            key=lambda answer: answer.tick,
            default=None,
        )
        return [] if newest is None else self._missing(self._spans(newest))

    def without_answer(self) -> list[MachineHeader]:
        """The machine's own words that no header of the soil has answered."""
        return [tick.sent for tick in self._ticks if tick.answer is None]

    def _missing(self, spans: dict[Stream, RowRange]) -> list[tuple[Stream, RowRange]]:
        return [
            (stream, gap)
            for stream, span in spans.items()
            for gap in self._incoming[stream].missing(span)
        ]

    def _spans(self, answer: SoilHeader) -> dict[Stream, RowRange]:
        """Rows since the answer taken last, through those that `answer` counts."""
        spans = {}
        for stream, span in answer.spans.items():
            since = self._incoming[stream].expected
            if span.first != since:  # there were answers in between
                span = RowRange(since, span.last + 1 - since)
            spans[stream] = span
        return spans
