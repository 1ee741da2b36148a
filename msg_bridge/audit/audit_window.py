"""Find the ticks of a run that were recorded completely and can be audited.

A recording begins and ends in the middle of ticks: some topics have more of the first and the last
ticks than others. Those ticks are not audited. What is missing in between is a fault.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msg_bridge.audit.collect import RunData, StreamKey
from msg_bridge.audit.membership import MembershipEvent, MembershipTimeline
from msg_bridge.audit.numbered_rows import NumberedRows, Spans
from msg_bridge.audit.soil_ticks import SoilTicks
from msg_bridge.audit.streams import counted_streams
from msg_bridge.contract.messages import Stream

__all__ = ["MAX_INCOMPLETE_EDGE_TICKS", "Window", "find_audit_window"]

MAX_INCOMPLETE_EDGE_TICKS = 50
"""Maximum number of incomplete ticks at either end of a recording that are no fault."""


@dataclass(frozen=True)
class Window:
    """Indices of the first and the last soil header whose ticks are audited."""

    first: int
    last: int

    @property
    def indices(self) -> slice:
        """Slice of the audited soil headers."""
        return slice(self.first, self.last + 1)


def find_audit_window(
    soil: SoilTicks,
    timeline: MembershipTimeline,
    data: RunData,
    streams: Mapping[StreamKey, NumberedRows],
) -> Window:
    """Return the window of ticks whose messages were recorded on all topics.

    Args:
        soil: the soil headers of the run and the rows that they count.
        timeline: the machine headers by soil header.
        data: the recorded messages.
        streams: the recorded rows of each stream.
    """
    size = len(soil.headers)
    is_incomplete = np.array(
        [any(e.is_header_missing for e in events) for events in timeline.events]
    )
    begins, ends = (
        [_count_leading_true(is_incomplete)],
        [size - _count_leading_true(is_incomplete[::-1])],
    )
    for counted in counted_streams(soil, timeline, data, streams):
        index = np.searchsorted(soil.ticks, counted.soil_ticks)
        _limit_to_recorded(begins, ends, counted.rows, counted.spans, index)
    if data.ledgers:
        begins.append(int(np.searchsorted(soil.ticks, min(data.ledgers))))
        ends.append(int(np.searchsorted(soil.ticks, max(data.ledgers), side="right")))
    begins.append(_first_with_all_rows_in_flight(soil, timeline, streams))
    first = 0
    if not soil.from_start:
        first = max((b for b in begins if b <= MAX_INCOMPLETE_EDGE_TICKS), default=0)
    last = min((e for e in ends if size - e <= MAX_INCOMPLETE_EDGE_TICKS), default=size) - 1
    first = min(first, size - 1)
    if not soil.from_start and data.ledgers and first <= last:
        # Movements before the window are taken from the ledger of its first tick.
        has_ledger = np.isin(soil.ticks[first : last + 1], list(data.ledgers))
        first += int(np.argmax(has_ledger & ~is_incomplete[first : last + 1]))
    return Window(first, max(last, first))


def _first_with_all_rows_in_flight(
    soil: SoilTicks, timeline: MembershipTimeline, streams: Mapping[StreamKey, NumberedRows]
) -> int:
    """Return the index of the first soil header whose rows in flight were all recorded.

    Conversion rows are in flight until a machine acknowledges them, and are counted until then.
    """
    acknowledged = np.array([_min_acknowledged_row(events) for events in timeline.events])
    conversions, span = streams[StreamKey(Stream.CONVERSION)], soil.spans[Stream.CONVERSION]
    first_recorded = (
        int(conversions.numbers[0]) if conversions.numbers.size else int(span.last[-1]) + 1
    )
    return _count_leading_true((acknowledged + 1 < first_recorded) & (acknowledged < span.last))


def _limit_to_recorded(
    begins: list[int],
    ends: list[int],
    rows: NumberedRows,
    spans: Spans,
    index: NDArray[np.integer],
) -> None:
    """Append the indices of the soil headers at which a stream begins and ends.

    Args:
        begins: indices of the first header with all rows of a stream; appended to.
        ends: indices of the first header after these without all rows; appended to.
        rows: recorded rows of the stream.
        spans: rows that the headers count.
        index: index of the soil header of each span, shape (n,).
    """
    counts = spans.last >= spans.first
    if not counts.any() or not rows.numbers.size:
        return
    early = np.flatnonzero(counts & (spans.first < rows.numbers[0]))
    late = np.flatnonzero(counts & (spans.last > rows.numbers[-1]))
    if early.size:
        begins.append(int(index[early[-1]]) + 1)
    if late.size:
        ends.append(int(index[late[0]]))


def _count_leading_true(flags: NDArray[np.bool_]) -> int:
    """Return the number of flags set before the first one that is not."""
    return int(flags.size if flags.all() else np.argmin(flags))


def _min_acknowledged_row(events: list[MembershipEvent]) -> int:
    """Return the lowest acknowledged conversion row of a tick; 2**62 if nothing is acknowledged."""
    return min(
        (e.header.conversions_received for e in events if e.header is not None), default=2**62
    )
