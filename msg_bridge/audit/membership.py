"""Which machine header the soil took in which of its ticks, from the receipts of its headers.

A receipt's `tick` tells how far the soil has taken a machine. In lockstep that is the header's own
tick; in real time it is older where the soil went on without a late machine, and a machine that it
drops is listed no more.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from msg_bridge.audit.collect import RunData, SessionKey
from msg_bridge.audit.numbered_rows import NumberedRows, Numbers, Spans, contiguous_ranges
from msg_bridge.audit.report import Check, Finding
from msg_bridge.contract.messages import MachineHeader, MachineReceipt, SoilHeader, Stream, Verb
from msg_bridge.contract.rows import ConversionKind, machine_ids_in

__all__ = [
    "UNKNOWN_TICK",
    "MembershipChange",
    "MembershipEvent",
    "MembershipTimeline",
    "SoilTicks",
    "build_timeline",
    "find_missing_headers",
    "find_release_rows",
]

UNKNOWN_TICK = -1
"""Of a header taken in a tick whose soil header is missing."""


class MembershipChange(Enum):
    """What became of a machine at a soil tick."""

    PRESENT = "present"
    """It takes part already when the bag begins."""
    JOINED = "joined"
    STEPPED = "stepped"
    LEFT = "left"
    DROPPED = "dropped"
    """It is listed no more and did not say that it leaves."""


@dataclass(frozen=True)
class MembershipEvent:
    """One machine at one soil tick.

    Attributes:
        tick: of the header taken.
        header: the header taken; None if it is missing, or DROPPED.
        owed: rows it is owed, if it JOINED.
    """

    change: MembershipChange
    session_id: SessionKey
    tick: int
    header: MachineHeader | None
    backlog: int = 0

    @property
    def is_header_missing(self) -> bool:
        """Whether a header is missing from the bag."""
        return self.header is None and self.change is not MembershipChange.DROPPED


@dataclass(frozen=True)
class SoilTicks:
    """The soil's headers in order, as arrays of shape (ticks,).

    Attributes:
        headers: as they are.
        ticks: their numbers.
        revisions: of the terrain, modulo 2**32.
        spans: the rows each counts, by stream.
    """

    headers: tuple[SoilHeader, ...]
    ticks: Numbers
    revisions: Numbers
    spans: dict[Stream, Spans]

    @classmethod
    def of(cls, data: RunData) -> SoilTicks:
        """From a run that has at least one."""
        headers = tuple(data.soil[tick] for tick in sorted(data.soil))
        ticks = [header.tick for header in headers]
        return cls(
            headers,
            np.array(ticks, dtype=np.int64),
            np.array([header.revision % 2**32 for header in headers], dtype=np.int64),
            {
                stream: Spans.of(ticks, [header.spans[stream] for header in headers])
                for stream in (Stream.CONVERSION, Stream.MAP_UPDATE, Stream.FORCE)
            },
        )

    @property
    def from_start(self) -> bool:
        """Whether the bag has the run's first tick."""
        return int(self.ticks[0]) == 0

    def missing(self) -> list[tuple[int, int]]:
        """Ticks without a header, as (first, last) of each gap."""
        before = np.flatnonzero(np.diff(self.ticks) > 1)
        return [(int(self.ticks[k]) + 1, int(self.ticks[k + 1]) - 1) for k in before]


@dataclass
class MembershipTimeline:
    """What became of all machines.

    Attributes:
        events: of each soil header.
        taken: by life, (machine's tick, soil's tick) of every header taken, rising.
        born: by life, the life in which its particles' numbers began: that of its last JOIN.
    """

    events: list[list[MembershipEvent]] = field(default_factory=list)
    accepted: dict[SessionKey, list[tuple[int, int]]] = field(default_factory=dict)
    numbering_session: dict[SessionKey, int] = field(default_factory=dict)

    def spans(self, data: RunData, session_id: SessionKey, stream: Stream) -> Spans:
        """SWEEP or LANDED rows of the headers taken of a life, by the machine's ticks."""
        steps = data.steps.get(session_id, {})
        headers = [steps[tick] for tick, _ in self.accepted.get(session_id, [])]
        return Spans.of(
            [header.tick for header in headers],
            [h.sweeps if stream is Stream.SWEEP else h.deposit_requests for h in headers],
        )

    def soil_ticks(self, session_id: SessionKey) -> Numbers:
        """The soil's tick that took each header of those spans."""
        return np.array([soil for _, soil in self.accepted.get(session_id, [])], dtype=np.int64)


def build_timeline(soil: SoilTicks, data: RunData) -> MembershipTimeline:
    """Tell what became of all machines."""
    timeline = MembershipTimeline()
    through: dict[SessionKey, int] = {}  # last tick taken
    before: dict[int, MachineReceipt] = {}
    for index, header in enumerate(soil.headers):
        now = {receipt.machine_id: receipt for receipt in header.receipts}
        follows = index > 0 and header.tick == soil.headers[index - 1].tick + 1
        events = []
        for machine_id, was in before.items():
            receipt = now.get(machine_id)
            stays = receipt is not None and receipt.session_id == was.session_id
            kept = receipt if stays else None
            event = _update_event(timeline, data, through, header, was, kept, follows=follows)
            if event is not None:
                events.append(event)
        for machine_id, receipt in now.items():
            was_there = machine_id in before and before[machine_id].session_id == receipt.session_id
            if not was_there:
                found = index == 0 and not soil.from_start
                events.append(_join_event(timeline, data, through, header, receipt, found=found))
        timeline.events.append(events)
        before = now
    return timeline


def find_missing_headers(
    soil: SoilTicks, timeline: MembershipTimeline, first: int, last: int
) -> list[Finding]:
    """Machine headers that soil headers from index `first` to `last` took and the bag lacks."""
    lacking: dict[SessionKey, list[int]] = {}
    findings = []
    for index in range(first, last + 1):
        tick = int(soil.ticks[index])
        for event in timeline.events[index]:
            if not event.is_header_missing:
                continue
            if event.change is MembershipChange.JOINED:
                text = f"machine {event.session_id[0]}'s join before tick {tick + 1} is missing"
                findings.append(Finding(Check.COMPLETENESS, text, tick, tick))
            else:
                lacking.setdefault(event.session_id, []).append(event.tick)
    for (machine_id, _), ticks in lacking.items():
        for begin, end in contiguous_ranges(ticks):
            one = begin == end
            which = f"header of tick {begin} is" if one else f"headers of {begin}..{end} are"
            text = f"machine {machine_id}'s {which} missing"
            findings.append(Finding(Check.COMPLETENESS, text, begin, end))
    return findings


def find_release_rows(
    soil: SoilTicks, timeline: MembershipTimeline, conversions: NumberedRows
) -> NDArray[np.bool_]:
    """Which conversion rows put down what an absent machine left: they answer no landed row.

    They name a machine that takes no part in their tick; numbers of particles do not tell.
    """
    rows = conversions.rows
    put_down = (rows["kind"] == ConversionKind.DEPOSIT) | (rows["kind"] == ConversionKind.OUTSIDE)
    at = np.searchsorted(soil.spans[Stream.CONVERSION].last, conversions.numbers)
    at = np.minimum(at, len(soil.headers) - 1)
    released = np.zeros(rows.size, dtype=np.bool_)
    for machine_id in machine_ids_in(rows):
        accepted = np.array(
            [
                _participates(machine_id, *each)
                for each in zip(soil.headers, timeline.events, strict=True)
            ]
        )
        released |= put_down & (rows["machine_id"] == machine_id) & ~accepted[at]
    return released


def _participates(machine_id: int, header: SoilHeader, events: list[MembershipEvent]) -> bool:
    """Whether rows of a soil tick can be answers to a machine; a late one still takes part."""
    what = {event.change for event in events if event.session_id[0] == machine_id}
    if what & {MembershipChange.STEPPED, MembershipChange.LEFT, MembershipChange.PRESENT}:
        return True
    return not what and any(receipt.machine_id == machine_id for receipt in header.receipts)


def _update_event(
    timeline: MembershipTimeline,
    data: RunData,
    through: dict[SessionKey, int],
    header: SoilHeader,
    was: MachineReceipt,
    receipt: MachineReceipt | None,
    *,
    follows: bool,
) -> MembershipEvent | None:
    """What became of a machine that took part.

    Args:
        receipt: None if it takes part no more.
        follows: whether the soil's last tick has a header too.
    """
    session_id = (was.machine_id, was.session_id)
    steps = data.steps.get(session_id, {})
    if receipt is None:
        leaving = [
            tick
            for tick in range(through[session_id] + 1, header.tick + 1)
            if tick in steps and steps[tick].verb is Verb.LEAVE
        ]
        if not leaving:
            return MembershipEvent(MembershipChange.DROPPED, session_id, header.tick, None)
        last = leaving[-1]
    else:
        last = receipt.tick
        if last <= through[session_id]:
            return None  # it is late: nothing of it was taken
    soil = header.tick if follows else UNKNOWN_TICK
    for tick in range(through[session_id] + 1, last + 1):
        if tick in steps:
            timeline.accepted.setdefault(session_id, []).append((tick, soil))
    through[session_id] = last
    what = MembershipChange.STEPPED if receipt is not None else MembershipChange.LEFT
    return MembershipEvent(what, session_id, last, steps.get(last))


def _join_event(
    timeline: MembershipTimeline,
    data: RunData,
    through: dict[SessionKey, int],
    header: SoilHeader,
    receipt: MachineReceipt,
    *,
    found: bool,
) -> MembershipEvent:
    """A machine that takes part from here on, or, if `found`, when the bag begins."""
    machine_id, session_id = receipt.machine_id, receipt.session_id
    last = receipt.tick
    through[machine_id, session_id] = last
    if found:
        timeline.numbering_session[machine_id, session_id] = session_id
        step = data.steps.get((machine_id, session_id), {}).get(last)
        if step is not None:
            timeline.accepted.setdefault((machine_id, session_id), []).append((last, header.tick))
        return MembershipEvent(MembershipChange.PRESENT, (machine_id, session_id), last, step)
    join = data.joins.get((machine_id, session_id))
    former = [each for each in timeline.numbering_session if each[0] == machine_id]
    returns = join is not None and join.verb is Verb.REJOIN
    timeline.numbering_session[machine_id, session_id] = (
        timeline.numbering_session[max(former)] if returns and former else session_id
    )
    return MembershipEvent(
        MembershipChange.JOINED, (machine_id, session_id), header.tick, join, receipt.backlog
    )
