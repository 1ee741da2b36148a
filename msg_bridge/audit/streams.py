"""The rows of all streams of a run, sorted by number, and the rows that headers count."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping
from typing import NamedTuple

import numpy as np

from msg_bridge.audit.collect import RunData, SessionKey, StreamKey
from msg_bridge.audit.membership import MembershipTimeline
from msg_bridge.audit.numbered_rows import NumberedRows, Numbers, Spans, order_rows
from msg_bridge.audit.soil_ticks import SoilTicks
from msg_bridge.contract.messages import Stream

__all__ = [
    "MACHINE_STREAMS",
    "CountedStream",
    "Gap",
    "accepted_spans",
    "counted_streams",
    "find_missing_streams",
    "order_all_streams",
]

MACHINE_STREAMS = (Stream.SWEEP, Stream.DEPOSIT_REQUEST)
"""Streams from machines to the soil, which machine headers count."""


class Gap(NamedTuple):
    """Counted rows that are missing.

    Attributes:
        first, last: number of the first and the last row.
        first_tick, last_tick: soil ticks that they belong to; `UNKNOWN_TICK` where headers are
            missing, too.
    """

    first: int
    last: int
    first_tick: int
    last_tick: int


class CountedStream(NamedTuple):
    """A stream whose rows are counted by headers that the soil published or accepted.

    Attributes:
        key: the stream.
        rows: its recorded rows.
        spans: the rows that each header counts.
        soil_ticks: the soil tick of each span, shape (n,).
    """

    key: StreamKey
    rows: NumberedRows
    spans: Spans
    soil_ticks: Numbers

    def gaps(self) -> list[Gap]:
        """Return the gaps among the counted rows, ascending."""
        gaps = []
        for first, last in self.spans.missing(self.rows):
            index = np.searchsorted(self.spans.last, np.array([first, last]))
            ticks = self.soil_ticks[np.minimum(index, self.soil_ticks.size - 1)]
            gaps.append(Gap(first, last, *map(int, ticks)))
        return gaps


def counted_streams(
    soil: SoilTicks,
    timeline: MembershipTimeline,
    data: RunData,
    streams: Mapping[StreamKey, NumberedRows],
    absent: Container[Stream] = (),
) -> Iterator[CountedStream]:
    """Yield the streams of the soil, then those of each session of a machine.

    Args:
        soil, timeline, data, streams: the run.
        absent: streams that are left out.
    """
    for stream, spans in soil.spans.items():
        if stream not in absent:
            key = StreamKey(stream)
            yield CountedStream(key, streams[key], spans, spans.ticks)
    for session in timeline.accepted:
        for stream in MACHINE_STREAMS:
            if stream not in absent:
                key = StreamKey(stream, *session)
                spans = accepted_spans(timeline, data, session, stream)
                yield CountedStream(key, streams[key], spans, timeline.soil_ticks(session))


def accepted_spans(
    timeline: MembershipTimeline, data: RunData, session: SessionKey, stream: Stream
) -> Spans:
    """Return the rows that the accepted headers of a session count, by the machine's ticks.

    Args:
        timeline: which headers were accepted.
        data: the run.
        session: the session.
        stream: SWEEP or DEPOSIT_REQUEST.
    """
    steps = data.steps.get(session, {})
    headers = [steps[tick] for tick, _ in timeline.accepted.get(session, [])]
    return Spans.of(
        [header.tick for header in headers],
        [h.sweeps if stream is Stream.SWEEP else h.deposit_requests for h in headers],
    )


def order_all_streams(
    soil: SoilTicks, timeline: MembershipTimeline, data: RunData
) -> dict[StreamKey, NumberedRows]:
    """Return the rows of every recorded stream, and empty ones of streams that headers count."""
    spans = {StreamKey(stream): span for stream, span in soil.spans.items()}
    for session in timeline.numbering_session:
        for stream in MACHINE_STREAMS:
            key = StreamKey(stream, *session)
            spans[key] = accepted_spans(timeline, data, session, stream)
    streams = {}
    for key in dict.fromkeys([*spans, *data.chunks]):
        span = spans.get(key)
        first = int(span.first[0]) if span is not None and span.first.size else None
        streams[key] = order_rows(key[0], data.chunks.get(key, []), first)
    return streams


def find_missing_streams(
    soil: SoilTicks, streams: dict[StreamKey, NumberedRows], data: RunData
) -> set[Stream]:
    """Return the streams that were not recorded at all although headers count rows of them."""
    counted = {stream: spans.total for stream, spans in soil.spans.items()}
    headers = [header for steps in data.steps.values() for header in steps.values()]
    counted[Stream.SWEEP] = sum(header.sweeps.count for header in headers)
    counted[Stream.DEPOSIT_REQUEST] = sum(header.deposit_requests.count for header in headers)
    recorded = {key[0] for key, rows in streams.items() if rows.numbers.size}
    return {stream for stream, count in counted.items() if count and stream not in recorded}
