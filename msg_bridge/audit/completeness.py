"""Find headers and rows that are missing, miscounted or contradictory."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from msg_bridge.audit.audit_window import Window
from msg_bridge.audit.collect import RunData, SessionKey, StreamKey
from msg_bridge.audit.membership import MembershipChange, MembershipTimeline
from msg_bridge.audit.numbered_rows import NumberedRows, contiguous_ranges
from msg_bridge.audit.report import Check, Finding
from msg_bridge.audit.soil_ticks import SoilTicks
from msg_bridge.audit.streams import CountedStream, counted_streams
from msg_bridge.bag.recording_begin import RECORD_FROM_BEGIN
from msg_bridge.contract.messages import Stream

__all__ = ["check_completeness"]

_MAX_FINDINGS = 20
"""Maximum number of gaps of one stream that have a finding of their own."""


def check_completeness(
    soil: SoilTicks,
    timeline: MembershipTimeline,
    data: RunData,
    streams: Mapping[StreamKey, NumberedRows],
    window: Window,
    absent: Collection[Stream],
) -> list[Finding]:
    """Return a finding for each fault of the recording in the audited ticks.

    Args:
        soil, timeline, data, streams: the run.
        window: the audited ticks.
        absent: streams that were not recorded at all; their gaps are not reported one by one.
    """
    findings = list(data.findings)
    low, high = int(soil.ticks[window.first]), int(soil.ticks[window.last])
    for first, last in soil.missing():
        text = f"the soil's {_headers_are(first, last)} missing"
        findings.append(Finding(Check.COMPLETENESS, text, first, last))
    findings += _find_missing_headers(soil, timeline, window)
    for counted in counted_streams(soil, timeline, data, streams, absent):
        findings += _find_missing_rows(counted, low, high)
    if not soil.missing():
        findings += _find_mislabelled_rows(soil, streams, window)
    for key, rows in streams.items():
        if rows.conflicts.size:
            text = (
                f"{rows.conflicts.size} {_stream_name(key)} row(s) were received with different"
                f" contents, the first is number {rows.conflicts[0]}"
            )
            findings.append(Finding(Check.COMPLETENESS, text))
    return findings


def _find_missing_headers(
    soil: SoilTicks, timeline: MembershipTimeline, window: Window
) -> list[Finding]:
    """Find machine headers that the soil accepted and that are not in the bag."""
    missing: dict[SessionKey, list[int]] = {}
    findings = []
    for index in range(window.first, window.last + 1):
        tick = int(soil.ticks[index])
        for event in timeline.events[index]:
            if not event.is_header_missing:
                continue
            if event.change is MembershipChange.JOINED:
                machine_id = event.session.machine_id
                text = f"machine {machine_id}'s join before tick {tick + 1} is missing"
                if index == 0:  # later ones were lost while the bag was recorded
                    text += f"; {RECORD_FROM_BEGIN}"
                findings.append(Finding(Check.COMPLETENESS, text, tick, tick))
            else:
                missing.setdefault(event.session, []).append(event.tick)
    for (machine_id, _), ticks in missing.items():
        for first, last in contiguous_ranges(ticks):
            text = f"machine {machine_id}'s {_headers_are(first, last)} missing"
            findings.append(Finding(Check.COMPLETENESS, text, first, last))
    return findings


def _find_mislabelled_rows(
    soil: SoilTicks, streams: Mapping[StreamKey, NumberedRows], window: Window
) -> list[Finding]:
    """Find rows with another tick, or revision, than the header that counts them."""
    findings = []
    for stream, field, expected in (
        (Stream.CONVERSION, "tick", soil.ticks % 2**32),
        (Stream.MAP_UPDATE, "revision", soil.revisions),
    ):
        span, rows = soil.spans[stream], streams[StreamKey(stream)]
        low, high = np.searchsorted(
            rows.numbers, (span.first[window.first], span.last[window.last] + 1)
        )
        index = np.searchsorted(span.last, rows.numbers[low:high])
        wrong = np.flatnonzero(rows.rows[field][low:high] != expected[index])
        if wrong.size:
            number, tick = rows.numbers[low + wrong[0]], int(span.ticks[index[wrong[0]]])
            text = (
                f"{wrong.size} {stream.name} row(s) have another {field} than their header,"
                f" the first is row {number} of tick {tick}"
            )
            findings.append(Finding(Check.COMPLETENESS, text, tick, tick))
    return findings


def _find_missing_rows(counted: CountedStream, low: int, high: int) -> list[Finding]:
    """Find rows of one stream that are missing in soil ticks `low` to `high`."""
    name, spans = _stream_name(counted.key), counted.spans
    findings = [
        Finding(
            Check.COMPLETENESS,
            f"the header of tick {spans.ticks[k]} counts {name} rows from {spans.first[k]}, the"
            f" header before up to {spans.last[k - 1]}",
            int(counted.soil_ticks[k]),
            int(counted.soil_ticks[k]),
        )
        for k in spans.discontinuities()
    ]
    gaps = [gap for gap in counted.gaps() if gap.last_tick >= low and gap.first_tick <= high]
    for first, last, begin, end in gaps[:_MAX_FINDINGS]:
        which = f"row {first} is" if first == last else f"rows {first}..{last} are"
        ticks = f"tick {begin}" if begin == end else f"ticks {begin}..{end}"
        text = f"{name} {which} missing ({ticks})"
        findings.append(Finding(Check.COMPLETENESS, text, begin, end))
    if len(gaps) > _MAX_FINDINGS:
        num_rows = sum(last - first + 1 for first, last, _, _ in gaps[_MAX_FINDINGS:])
        num_gaps = len(gaps) - _MAX_FINDINGS
        text = f"{name}: {num_rows} more rows are missing in {num_gaps} more gaps"
        begin, end = gaps[_MAX_FINDINGS].first_tick, gaps[-1].last_tick
        findings.append(Finding(Check.COMPLETENESS, text, begin, end))
    return findings


def _headers_are(first: int, last: int) -> str:
    if first == last:
        return f"header of tick {first} is"
    return f"headers of ticks {first}..{last} are"


def _stream_name(key: StreamKey) -> str:
    if not key.machine_id:
        return key.stream.name
    return f"machine {key.machine_id}'s {key.stream.name}"
