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

from msg_bridge.audit.gather import EpochData, Life
from msg_bridge.audit.report import Check, Finding
from msg_bridge.audit.streams import NumberedRows, Numbers, Spans, runs
from msg_bridge.contract.messages import MachineHeader, SoilHeader, SourceReceipt, Stream, Verb
from msg_bridge.contract.rows import Kind, sources_of

__all__ = [
    "UNKNOWN_TICK",
    "Event",
    "Happening",
    "SoilTicks",
    "Story",
    "follow",
    "missing_headers",
    "released_rows",
]

UNKNOWN_TICK = -1
"""Of a header taken in a tick whose soil header is missing."""


class Happening(Enum):
    """What became of a machine at a soil tick."""

    FOUND = "found"
    """It takes part already when the bag begins."""
    ENTERED = "entered"
    STEPPED = "stepped"
    LEFT = "left"
    DROPPED = "dropped"
    """It is listed no more and did not say that it leaves."""


@dataclass(frozen=True)
class Event:
    """One machine at one soil tick.

    Attributes:
        tick: of the header taken.
        header: the header taken; None if it is missing, or DROPPED.
        owed: rows it is owed, if it ENTERED.
    """

    what: Happening
    life: Life
    tick: int
    header: MachineHeader | None
    owed: int = 0

    @property
    def lacks_header(self) -> bool:
        """Whether a header is missing from the bag."""
        return self.header is None and self.what is not Happening.DROPPED


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
    def of(cls, data: EpochData) -> SoilTicks:
        """From a run that has at least one."""
        headers = tuple(data.soil[tick] for tick in sorted(data.soil))
        ticks = [header.tick for header in headers]
        return cls(
            headers,
            np.array(ticks, dtype=np.int64),
            np.array([header.revision % 2**32 for header in headers], dtype=np.int64),
            {
                stream: Spans.of(ticks, [header.spans[stream] for header in headers])
                for stream in (Stream.CONVERSION, Stream.CHANGED, Stream.FORCE)
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
class Story:
    """What became of all machines.

    Attributes:
        events: of each soil header.
        taken: by life, (machine's tick, soil's tick) of every header taken, rising.
        born: by life, the life in which its particles' numbers began: that of its last JOIN.
    """

    events: list[list[Event]] = field(default_factory=list)
    taken: dict[Life, list[tuple[int, int]]] = field(default_factory=dict)
    born: dict[Life, int] = field(default_factory=dict)

    def spans(self, data: EpochData, life: Life, stream: Stream) -> Spans:
        """SWEEP or LANDED rows of the headers taken of a life, by the machine's ticks."""
        steps = data.steps.get(life, {})
        headers = [steps[tick] for tick, _ in self.taken.get(life, [])]
        return Spans.of(
            [header.tick for header in headers],
            [h.sweeps if stream is Stream.SWEEP else h.landed for h in headers],
        )

    def soil_ticks(self, life: Life) -> Numbers:
        """The soil's tick that took each header of those spans."""
        return np.array([soil for _, soil in self.taken.get(life, [])], dtype=np.int64)


def follow(soil: SoilTicks, data: EpochData) -> Story:
    """Tell what became of all machines."""
    story = Story()
    through: dict[Life, int] = {}  # last tick taken
    before: dict[int, SourceReceipt] = {}
    for index, header in enumerate(soil.headers):
        now = {receipt.source: receipt for receipt in header.receipts}
        follows = index > 0 and header.tick == soil.headers[index - 1].tick + 1
        events = []
        for source, was in before.items():
            receipt = now.get(source)
            stays = receipt is not None and receipt.life == was.life
            kept = receipt if stays else None
            event = _next(story, data, through, header, was, kept, follows=follows)
            if event is not None:
                events.append(event)
        for source, receipt in now.items():
            was_there = source in before and before[source].life == receipt.life
            if not was_there:
                found = index == 0 and not soil.from_start
                events.append(_entered(story, data, through, header, receipt, found=found))
        story.events.append(events)
        before = now
    return story


def missing_headers(soil: SoilTicks, story: Story, first: int, last: int) -> list[Finding]:
    """Machine headers that soil headers from index `first` to `last` took and the bag lacks."""
    lacking: dict[Life, list[int]] = {}
    findings = []
    for index in range(first, last + 1):
        tick = int(soil.ticks[index])
        for event in story.events[index]:
            if not event.lacks_header:
                continue
            if event.what is Happening.ENTERED:
                text = f"machine {event.life[0]}'s join before tick {tick + 1} is missing"
                findings.append(Finding(Check.COMPLETENESS, text, tick, tick))
            else:
                lacking.setdefault(event.life, []).append(event.tick)
    for (source, _), ticks in lacking.items():
        for begin, end in runs(ticks):
            one = begin == end
            which = f"header of tick {begin} is" if one else f"headers of {begin}..{end} are"
            text = f"machine {source}'s {which} missing"
            findings.append(Finding(Check.COMPLETENESS, text, begin, end))
    return findings


def released_rows(soil: SoilTicks, story: Story, conversions: NumberedRows) -> NDArray[np.bool_]:
    """Which conversion rows put down what an absent machine left: they answer no landed row.

    They name a machine that takes no part in their tick; numbers of particles do not tell.
    """
    rows = conversions.rows
    put_down = (rows["kind"] == Kind.DEPOSIT) | (rows["kind"] == Kind.OUTSIDE)
    at = np.searchsorted(soil.spans[Stream.CONVERSION].last, conversions.numbers)
    at = np.minimum(at, len(soil.headers) - 1)
    released = np.zeros(rows.size, dtype=np.bool_)
    for source in sources_of(rows):
        taken = np.array(
            [_takes_part(source, *each) for each in zip(soil.headers, story.events, strict=True)]
        )
        released |= put_down & (rows["source"] == source) & ~taken[at]
    return released


def _takes_part(source: int, header: SoilHeader, events: list[Event]) -> bool:
    """Whether rows of a soil tick can be answers to a machine; a late one still takes part."""
    what = {event.what for event in events if event.life[0] == source}
    if what & {Happening.STEPPED, Happening.LEFT, Happening.FOUND}:
        return True
    return not what and any(receipt.source == source for receipt in header.receipts)


def _next(
    story: Story,
    data: EpochData,
    through: dict[Life, int],
    header: SoilHeader,
    was: SourceReceipt,
    receipt: SourceReceipt | None,
    *,
    follows: bool,
) -> Event | None:
    """What became of a machine that took part.

    Args:
        receipt: None if it takes part no more.
        follows: whether the soil's last tick has a header too.
    """
    life = (was.source, was.life)
    steps = data.steps.get(life, {})
    if receipt is None:
        leaving = [
            tick
            for tick in range(through[life] + 1, header.tick + 1)
            if tick in steps and steps[tick].verb is Verb.LEAVE
        ]
        if not leaving:
            return Event(Happening.DROPPED, life, header.tick, None)
        last = leaving[-1]
    else:
        last = receipt.tick
        if last <= through[life]:
            return None  # it is late: nothing of it was taken
    soil = header.tick if follows else UNKNOWN_TICK
    for tick in range(through[life] + 1, last + 1):
        if tick in steps:
            story.taken.setdefault(life, []).append((tick, soil))
    through[life] = last
    what = Happening.STEPPED if receipt is not None else Happening.LEFT
    return Event(what, life, last, steps.get(last))


def _entered(
    story: Story,
    data: EpochData,
    through: dict[Life, int],
    header: SoilHeader,
    receipt: SourceReceipt,
    *,
    found: bool,
) -> Event:
    """A machine that takes part from here on, or, if `found`, when the bag begins."""
    source, life = receipt.source, receipt.life
    last = receipt.tick
    through[source, life] = last
    if found:
        story.born[source, life] = life
        step = data.steps.get((source, life), {}).get(last)
        if step is not None:
            story.taken.setdefault((source, life), []).append((last, header.tick))
        return Event(Happening.FOUND, (source, life), last, step)
    join = data.joins.get((source, life))
    former = [each for each in story.born if each[0] == source]
    returns = join is not None and join.verb is Verb.RETURN
    story.born[source, life] = story.born[max(former)] if returns and former else life
    return Event(Happening.ENTERED, (source, life), header.tick, join, receipt.owed)
