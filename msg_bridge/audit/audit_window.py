"""Which ticks of a run a bag holds in full, and what is missing among them.

A recording begins and ends in the middle of ticks: of the first and the last few, some topics have
more than others. Those ticks are not audited. What is missing between them is a gap.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from msg_bridge.audit.collect import RunData, StreamKey
from msg_bridge.audit.membership import MembershipTimeline, SoilTicks, find_missing_headers
from msg_bridge.audit.numbered_rows import NumberedRows, Spans, order_rows
from msg_bridge.audit.report import Check, Finding
from msg_bridge.contract.messages import Stream

__all__ = [
    "MAX_INCOMPLETE_EDGE_TICKS",
    "Window",
    "check_completeness",
    "find_audit_window",
    "order_all_streams",
]

MAX_INCOMPLETE_EDGE_TICKS = 50
"""Most ticks at either end of a recording that may be incomplete without being a gap."""

_MAX_FINDINGS = 20  # gaps of one stream told one by one


@dataclass(frozen=True)
class Window:
    """Indices of the first and the last soil header whose ticks are audited."""

    first: int
    last: int

    @property
    def indices(self) -> slice:
        """Of the soil headers audited."""
        return slice(self.first, self.last + 1)


def order_all_streams(
    soil: SoilTicks, timeline: MembershipTimeline, data: RunData
) -> dict[StreamKey, NumberedRows]:
    """All rows in order; of every stream that headers count, also where the bag has none."""
    spans: dict[StreamKey, Spans] = {(s, 0, 0): span for s, span in soil.spans.items()}
    for session_id in timeline.numbering_session:
        for stream in (Stream.SWEEP, Stream.DEPOSIT_REQUEST):
            spans[(stream, *session_id)] = timeline.spans(data, session_id, stream)
    streams = {}
    for key in dict.fromkeys([*spans, *data.chunks]):
        span = spans.get(key)
        first = int(span.first[0]) if span is not None and span.first.size else None
        streams[key] = order_rows(key[0], data.chunks.get(key, []), first)
    return streams


def find_audit_window(
    soil: SoilTicks,
    timeline: MembershipTimeline,
    data: RunData,
    streams: Mapping[StreamKey, NumberedRows],
) -> Window:
    """The ticks to audit."""
    size = len(soil.headers)
    lacking = np.array([any(e.is_header_missing for e in events) for events in timeline.events])
    begins, ends = [_count_leading_true(lacking)], [size - _count_leading_true(lacking[::-1])]
    for stream, spans in soil.spans.items():
        _limit_to_recorded(begins, ends, streams[stream, 0, 0], spans, np.arange(size))
    for session_id in timeline.accepted:
        for stream in (Stream.SWEEP, Stream.DEPOSIT_REQUEST):
            spans = timeline.spans(data, session_id, stream)
            where = np.searchsorted(soil.ticks, timeline.soil_ticks(session_id))
            _limit_to_recorded(begins, ends, streams[(stream, *session_id)], spans, where)
    if data.ledgers:
        begins.append(int(np.searchsorted(soil.ticks, min(data.ledgers))))
        ends.append(int(np.searchsorted(soil.ticks, max(data.ledgers), side="right")))
    # What is acknowledged only later is in flight, and has to be there to be counted.
    acknowledged = np.array([_min_acknowledged_row(events) for events in timeline.events])
    conversions, span = streams[Stream.CONVERSION, 0, 0], soil.spans[Stream.CONVERSION]
    low = int(conversions.numbers[0]) if conversions.numbers.size else int(span.last[-1]) + 1
    begins.append(_count_leading_true((acknowledged + 1 < low) & (acknowledged < span.last)))
    first = (
        0
        if soil.from_start
        else max((b for b in begins if b <= MAX_INCOMPLETE_EDGE_TICKS), default=0)
    )
    last = min((e for e in ends if size - e <= MAX_INCOMPLETE_EDGE_TICKS), default=size) - 1
    return Window(min(first, size - 1), max(last, min(first, size - 1)))


def check_completeness(
    soil: SoilTicks,
    timeline: MembershipTimeline,
    data: RunData,
    streams: Mapping[StreamKey, NumberedRows],
    window: Window,
    absent: Collection[Stream],
) -> list[Finding]:
    """What is missing, counted wrongly, or there twice with different content.

    Args:
        absent: streams the bag has nothing of, of which not every gap is told.
    """
    findings = list(data.findings)
    low, high = int(soil.ticks[window.first]), int(soil.ticks[window.last])
    for first, last in soil.missing():
        which = f"header of tick {first} is" if first == last else f"headers of {first}..{last} are"
        text = f"the soil's {which} missing"
        findings.append(Finding(Check.COMPLETENESS, text, first, last))
    findings += find_missing_headers(soil, timeline, window.first, window.last)
    for stream, spans in soil.spans.items():
        if stream in absent:
            continue
        key = (stream, 0, 0)
        findings += _find_missing_rows(
            _stream_name(key), streams[key], spans, spans.ticks, low, high
        )
    for session_id in timeline.accepted:
        for stream in {Stream.SWEEP, Stream.DEPOSIT_REQUEST}.difference(absent):
            machine_key = (stream, *session_id)
            spans = timeline.spans(data, session_id, stream)
            ticks = timeline.soil_ticks(session_id)
            findings += _find_missing_rows(
                _stream_name(machine_key), streams[machine_key], spans, ticks, low, high
            )
    if not soil.missing():
        findings += _find_mislabelled_rows(soil, streams, window)
    for each, rows in streams.items():
        if rows.conflicts.size:
            findings.append(
                Finding(
                    Check.COMPLETENESS,
                    f"{rows.conflicts.size} {_stream_name(each)} row(s) came twice with different content,"
                    f" the first is number {rows.conflicts[0]}",
                )
            )
    return findings


def _find_mislabelled_rows(
    soil: SoilTicks, streams: Mapping[StreamKey, NumberedRows], window: Window
) -> list[Finding]:
    """Rows that say another tick, or revision, than the header that counts them."""
    findings = []
    for stream, field, right in (
        (Stream.CONVERSION, "tick", soil.ticks % 2**32),
        (Stream.MAP_UPDATE, "revision", soil.revisions),
    ):
        span, all_rows = soil.spans[stream], streams[stream, 0, 0]
        low, high = np.searchsorted(
            all_rows.numbers, (span.first[window.first], span.last[window.last] + 1)
        )
        at = np.searchsorted(span.last, all_rows.numbers[low:high])
        wrong = np.flatnonzero(all_rows.rows[field][low:high] != right[at])
        if wrong.size:
            number, tick = all_rows.numbers[low + wrong[0]], int(span.ticks[at[wrong[0]]])
            text = (
                f"{wrong.size} {stream.name} row(s) say another {field} than their header,"
                f" the first is row {number} of tick {tick}"
            )
            findings.append(Finding(Check.COMPLETENESS, text, tick, tick))
    return findings


def _find_missing_rows(
    name: str, rows: NumberedRows, spans: Spans, soil_ticks: np.ndarray, low: int, high: int
) -> list[Finding]:
    """What of one stream is missing in soil ticks `low` to `high`."""
    findings = [
        Finding(
            Check.COMPLETENESS,
            f"the header of tick {spans.ticks[k]} counts {name} rows from {spans.first[k]}, the"
            f" header before up to {spans.last[k - 1]}",
            int(soil_ticks[k]),
            int(soil_ticks[k]),
        )
        for k in spans.discontinuities()
    ]
    gaps = []
    for first, last in spans.missing(rows):
        ends = np.array([first, last])
        index = np.minimum(np.searchsorted(spans.last, ends), spans.ticks.size - 1)
        begin, end = (int(soil_ticks[k]) for k in index)
        if end >= low and begin <= high:
            gaps.append((first, last, begin, end))
    for first, last, begin, end in gaps[:_MAX_FINDINGS]:
        which = f"row {first} is" if first == last else f"rows {first}..{last} are"
        where = f"tick {begin}" if begin == end else f"ticks {begin}..{end}"
        text = f"{name} {which} missing ({where})"
        findings.append(Finding(Check.COMPLETENESS, text, begin, end))
    if len(gaps) > _MAX_FINDINGS:
        more = sum(last - first + 1 for first, last, _, _ in gaps[_MAX_FINDINGS:])
        text = f"{name}: {more} more rows are missing in {len(gaps) - _MAX_FINDINGS} more places"
        begin, end = gaps[_MAX_FINDINGS][2], gaps[-1][3]
        findings.append(Finding(Check.COMPLETENESS, text, begin, end))
    return findings


def _limit_to_recorded(
    begins: list[int], ends: list[int], rows: NumberedRows, spans: Spans, where: np.ndarray
) -> None:
    """Where a stream begins and ends, as indices of soil headers; `where` is that of each span."""
    counts = spans.last >= spans.first
    if not counts.any() or not rows.numbers.size:
        return
    early = np.flatnonzero(counts & (spans.first < rows.numbers[0]))
    late = np.flatnonzero(counts & (spans.last > rows.numbers[-1]))
    if early.size:
        begins.append(int(where[early[-1]]) + 1)
    if late.size:
        ends.append(int(where[late[0]]))


def _count_leading_true(flags: np.ndarray) -> int:
    """How many of the first flags are set, in a row."""
    return int(flags.size if flags.all() else np.argmin(flags))


def _min_acknowledged_row(events: list) -> int:  # type: ignore[type-arg]
    """Oldest conversion row that a machine acknowledges in a tick; all of them if none does."""
    return min(
        (e.header.conversions_received for e in events if e.header is not None),
        default=2**62,
    )


def _stream_name(key: StreamKey) -> str:
    stream, machine_id, _ = key
    return f"{stream.name}" if not machine_id else f"machine {machine_id}'s {stream.name}"
