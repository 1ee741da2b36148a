"""Split a run at ticks whose rows were lost, and join the audits of its parts.

After a lost row no sum that starts before it is known. Each part is therefore audited as a bag that
begins in the middle of a run: with its first terrain map, and with movements before it taken from
the published ledger. What lies between the parts is unknown, which is neither right nor wrong.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from msg_bridge.audit.audit_window import Window
from msg_bridge.audit.collect import RunData, StreamKey
from msg_bridge.audit.membership import UNKNOWN_TICK, MembershipTimeline
from msg_bridge.audit.numbered_rows import NumberedRows
from msg_bridge.audit.report import CheckResult
from msg_bridge.audit.soil_ticks import SoilTicks
from msg_bridge.audit.streams import CountedStream, counted_streams
from msg_bridge.contract.messages import Stream

__all__ = ["describe_unknown_ticks", "join_check_results", "split_at_losses"]

TickRange = tuple[int, int]
"""First and last tick."""

_MIN_PART_TICKS = 5
"""Minimum number of ticks between lost rows that are audited; in fewer there is little to compare,
and the edges are not known."""

_AUDITED_STREAMS = (Stream.CONVERSION, Stream.MAP_UPDATE, Stream.DEPOSIT_REQUEST)
"""Streams without whose rows the sums of volumes are not known."""


def split_at_losses(
    soil: SoilTicks,
    timeline: MembershipTimeline,
    data: RunData,
    streams: Mapping[StreamKey, NumberedRows],
    window: Window,
    absent: Collection[Stream],
) -> list[RunData]:
    """Return the parts of a run without lost rows, in order; the run itself if none was lost.

    Args:
        soil, timeline, data, streams: the run.
        window: the audited ticks; rows that are missing before and after are no losses.
        absent: streams that were not recorded at all, which are no losses in single ticks.
    """
    lost = np.zeros(soil.ticks.size, dtype=np.bool_)
    for counted in counted_streams(soil, timeline, data, streams, absent):
        if counted.key.stream in _AUDITED_STREAMS and counted.rows.numbers.size:
            _mark_lost(lost, counted, soil)
    lost[: window.first] = lost[window.last + 1 :] = False
    if not lost.any() or lost.all():
        return [data]
    _mark_ticks_after_missing_headers(lost, soil)
    edges = np.flatnonzero(np.diff(np.concatenate([[True], lost, [True]])))
    ranges = [
        (int(first), int(end) - 1) for first, end in zip(edges[::2], edges[1::2], strict=True)
    ]
    longest = max(last - first for first, last in ranges)
    return [
        _part(soil, data, streams, first, last)
        for first, last in ranges
        if last - first >= min(_MIN_PART_TICKS - 1, longest)
    ]


def _mark_lost(lost: NDArray[np.bool_], counted: CountedStream, soil: SoilTicks) -> None:
    """Mark the soil headers with lost rows of a stream.

    Args:
        lost: which soil headers have lost rows, shape (n,); changed in place.
        counted: the stream.
        soil: the soil headers.
    """
    for gap in counted.gaps():
        ticks = [tick for tick in (gap.first_tick, gap.last_tick) if tick != UNKNOWN_TICK]
        if len(ticks) < 2:  # across missing headers of the soil
            _mark_ticks_after_missing_headers(lost, soil)
            if not ticks:
                continue
        low, high = np.searchsorted(soil.ticks, (ticks[0], ticks[-1]))
        lost[low : min(int(high), lost.size - 1) + 1] = True


def _mark_ticks_after_missing_headers(lost: NDArray[np.bool_], soil: SoilTicks) -> None:
    """Mark the soil headers that follow missing ones.

    In which tick the rows of machines were accepted is not known there.
    """
    lost[1:] |= np.diff(soil.ticks) > 1


def _part(
    soil: SoilTicks,
    data: RunData,
    streams: Mapping[StreamKey, NumberedRows],
    first: int,
    last: int,
) -> RunData:
    """Return the messages of the soil headers with the indices `first` to `last`."""
    low, high = int(soil.ticks[first]), int(soil.ticks[last])
    chunks = dict(data.chunks)
    for stream, spans in soil.spans.items():
        rows = streams[StreamKey(stream)]
        inside = (rows.numbers >= spans.first[first]) & (rows.numbers <= spans.last[last])
        chunks[StreamKey(stream)] = [rows.rows[inside]]
    return replace(
        data,
        soil={tick: header for tick, header in data.soil.items() if low <= tick <= high},
        chunks=chunks,
        keyframes=data.keyframes.between(int(soil.revisions[first]), int(soil.revisions[last])),
        ledgers={tick: each for tick, each in data.ledgers.items() if low <= tick <= high},
        findings=[],
    )


def describe_unknown_ticks(run: TickRange, audited: Sequence[TickRange]) -> str:
    """Return the ticks that no part covers, as "unknown from tick 5 to 9 and from ...".

    Args:
        run: the ticks to audit.
        audited: the audited ticks of each part, ascending.
    """
    covered = [(0, run[0] - 1), *audited, (run[1] + 1, 0)]
    gaps = [(before[1] + 1, after[0] - 1) for before, after in pairwise(covered)]
    ranges = [f"from tick {first} to {last}" for first, last in gaps if first <= last]
    return f"unknown {' and '.join(ranges)}" if ranges else ""


def join_check_results(parts: Sequence[Sequence[CheckResult]], unknown: str) -> list[CheckResult]:
    """Return one result of each check from those of all parts of a run.

    Args:
        parts: the results of each part, the same checks in the same order.
        unknown: description of the ticks between the parts; empty if there is only one part.
    """
    joined = []
    for results in zip(*parts, strict=True):
        detail = "; ".join(
            [*dict.fromkeys(each.detail for each in results), *filter(None, [unknown])]
        )
        done = not unknown and all(each.done for each in results)
        joined.append(CheckResult(results[0].check, done, detail))
    return joined
