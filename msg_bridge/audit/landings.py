"""Landed rows and their answers, matched one to one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msg_bridge.audit.gather import EpochData, StreamKey
from msg_bridge.audit.report import Check, CheckResult, Finding
from msg_bridge.audit.streams import NumberedRows, Numbers
from msg_bridge.audit.ticks import UNKNOWN_TICK, Happening, SoilTicks, Story
from msg_bridge.audit.window import Window
from msg_bridge.contract.messages import Stream
from msg_bridge.contract.rows import CONVERSION, Kind, Rows

__all__ = ["audit_landings", "audit_owed"]

_SHOWN = 10


@dataclass(frozen=True)
class _Side:
    """Landed rows or answers, by source, particle and order, shape (n,).

    Attributes:
        who: source and particle in one number.
        volume: [mm^3].
        tick: soil tick in which it was taken or given; UNKNOWN_TICK if not known.
        extra: the life in which the particle's numbers began, or the kind of answer.
        what: its soil and its moisture in one number.
    """

    who: Numbers
    volume: Numbers
    tick: Numbers
    extra: Numbers
    what: Numbers

    def where(self, keep: NDArray[np.bool_]) -> _Side:
        fields = (self.who, self.volume, self.tick, self.extra, self.what)
        return _Side(*(each[keep] for each in fields))


def audit_landings(
    soil: SoilTicks,
    window: Window,
    story: Story,
    data: EpochData,
    streams: Mapping[StreamKey, NumberedRows],
    released: NDArray[np.bool_],
    *,
    has_landed: bool,
) -> tuple[CheckResult, list[Finding]]:
    """Match them.

    Args:
        released: which conversion rows put down what an absent machine left.
        has_landed: whether the bag has the topic of landed rows, or needs none.
    """
    if not has_landed:
        return CheckResult(Check.LANDINGS, False, "the bag has no landed rows"), []
    span = soil.spans[Stream.CONVERSION]
    conversions = streams[Stream.CONVERSION, 0, 0]
    low, high = int(span.first[window.first]), int(span.last[window.last])
    answers = _answers(soil, conversions, released, low, high)
    landed = _landed(soil, window, story, data, streams)
    findings = []
    names, index = np.unique(np.concatenate([answers.who, landed.who]), return_inverse=True)
    given = np.bincount(index[: answers.who.size], minlength=names.size)
    asked = np.bincount(index[answers.who.size :], minlength=names.size)
    for who in names[given > asked][:_SHOWN].tolist():
        text = f"{_particle(who)} is answered more often than it landed"
        tick = int(answers.tick[answers.who == who][-1])
        findings.append(Finding(Check.LANDINGS, f"{text} (tick {tick})", tick, tick))
    for who in names[asked > given][:_SHOWN].tolist():
        tick = int(landed.tick[landed.who == who][-1])
        text = f"{_particle(who)} landed and was not answered"
        place = None if tick == UNKNOWN_TICK else tick
        findings.append(Finding(Check.LANDINGS, f"{text} (tick {tick})", place, place))
    uneven = int((given != asked).sum())
    if uneven > 2 * _SHOWN:
        findings.append(Finding(Check.LANDINGS, f"{uneven} particles in all are answered wrongly"))
    answers = answers.where(np.isin(answers.who, names[given == asked]))
    landed = landed.where(np.isin(landed.who, names[given == asked]))
    findings += _unequal(answers, landed)
    findings += _paid_twice(answers, landed)
    return CheckResult(Check.LANDINGS, True, f"{landed.who.size} landings, each answered"), findings


def audit_owed(
    window: Window,
    story: Story,
    streams: Mapping[StreamKey, NumberedRows],
) -> tuple[CheckResult, list[Finding]]:
    """Rows sent to machines that came back: copies of those they lacked."""
    conversions = streams[Stream.CONVERSION, 0, 0]
    findings, checked = [], 0
    missing = []
    names = [name for name in CONVERSION.names or () if name != "seq"]
    for events in story.events[: window.last + 1]:
        for event in events:
            header, source = event.header, event.life[0]
            if event.what is Happening.ENTERED and event.owed and header is not None:
                through = header.conversions_received
                owed = streams.get((Stream.OWED, *event.life))
                rows = conversions.rows
                begins = int(conversions.numbers[0]) if rows.size else 2**62
                if owed is None or owed.numbers.size < event.owed or begins > through + 1 > 1:
                    missing.append(source)
                    continue
                due = (rows["source"] == source) & (conversions.numbers > through)
                expected = rows[due][: event.owed]
                checked += event.owed
                same = expected.size == owed.rows.size and all(
                    # Bit by bit, since a place may be no number; seq is of their own stream.
                    expected[name].tobytes() == owed.rows[name].tobytes()
                    for name in names
                )
                if not same:
                    text = f"the rows owed to machine {source} are not those it lacks"
                    findings.append(Finding(Check.OWED, text))
    if missing:
        told = ", ".join(str(source) for source in sorted(set(missing)))
        detail = f"those of machine {told} are not all in the bag"
        return CheckResult(Check.OWED, False, detail), findings
    return CheckResult(Check.OWED, True, f"{checked} row(s)" if checked else "none"), findings


def _answers(
    soil: SoilTicks, conversions: NumberedRows, released: NDArray[np.bool_], low: int, high: int
) -> _Side:
    rows = conversions.rows
    answers = (rows["kind"] != Kind.EXCAVATE) & ~released
    answers &= (conversions.numbers >= low) & (conversions.numbers <= high)
    own = rows[answers]
    tick = soil.spans[Stream.CONVERSION].tick_of(conversions.numbers[answers])
    return _sorted(own, tick, own["kind"].astype(np.int64))


def _landed(
    soil: SoilTicks,
    window: Window,
    story: Story,
    data: EpochData,
    streams: Mapping[StreamKey, NumberedRows],
) -> _Side:
    low, high = int(soil.ticks[window.first]), int(soil.ticks[window.last])
    sides = []
    for life in sorted(story.taken):
        stream = streams[(Stream.LANDED, *life)]
        spans, ticks = story.spans(data, life, Stream.LANDED), story.soil_ticks(life)
        at = np.minimum(np.searchsorted(spans.last, stream.numbers), spans.ticks.size - 1)
        counted = (stream.numbers >= spans.first[at]) & (stream.numbers <= spans.last[at])
        # Rows between two headers are of headers that the bag lacks.
        between = (stream.numbers >= spans.first[0]) & (stream.numbers <= spans.last[-1])
        tick = np.where(counted, ticks[at], UNKNOWN_TICK)
        keep = between & ((tick == UNKNOWN_TICK) | ((tick >= low) & (tick <= high)))
        born = np.full(int(keep.sum()), story.born[life], dtype=np.int64)
        sides.append((stream.rows[keep], tick[keep], born))
    if not sides:
        nothing = np.zeros(0, dtype=np.int64)
        return _Side(nothing, nothing, nothing, nothing, nothing)
    rows, tick, born = (np.concatenate(parts) for parts in zip(*sides, strict=True))
    return _sorted(rows, tick, born)


def _sorted(rows: Rows, tick: Numbers, extra: Numbers) -> _Side:
    who = rows["source"].astype(np.int64) << 32 | rows["particle_id"]
    order = np.argsort(who, kind="stable")
    volume = rows["volume_mm3"].astype(np.int64)
    what = rows["soil"].astype(np.int64) << 8 | rows["moisture"]
    return _Side(who[order], volume[order], tick[order], extra[order], what[order])


def _unequal(answers: _Side, landed: _Side) -> list[Finding]:
    """Answers of another volume or soil, or in another tick, than their landings."""
    findings = []
    volume = np.flatnonzero(answers.volume != landed.volume)
    later = (landed.tick != UNKNOWN_TICK) & (answers.tick != landed.tick)
    for k in volume[:_SHOWN].tolist():
        tick = int(answers.tick[k])
        text = (
            f"{_particle(int(answers.who[k]))} landed with {landed.volume[k]} mm3 and was answered"
            f" with {answers.volume[k]} mm3 in tick {tick}"
        )
        findings.append(Finding(Check.LANDINGS, text, tick, tick))
    soil = np.flatnonzero(answers.what != landed.what)
    for k in soil[:_SHOWN].tolist():
        tick = int(answers.tick[k])
        text = (
            f"{_particle(int(answers.who[k]))} landed as {_soil(int(landed.what[k]))} and was"
            f" answered as {_soil(int(answers.what[k]))} in tick {tick}"
        )
        findings.append(Finding(Check.LANDINGS, text, tick, tick))
    for k in np.flatnonzero(later)[:_SHOWN].tolist():
        tick = int(answers.tick[k])
        name = _particle(int(answers.who[k]))
        text = f"{name} landed in tick {landed.tick[k]} and was answered in tick {tick}"
        findings.append(Finding(Check.LANDINGS, text, tick, tick))
    more = max(volume.size, soil.size, int(later.sum())) - _SHOWN
    if more > 0:
        findings.append(Finding(Check.LANDINGS, f"{more} more landings have a wrong answer"))
    return findings


def _paid_twice(answers: _Side, landed: _Side) -> list[Finding]:
    """Particles that landed again after they had become terrain or had left the map."""
    paid = (answers.extra == Kind.DEPOSIT) | (answers.extra == Kind.OUTSIDE)
    answers, landed = answers.where(paid), landed.where(paid)
    same = (answers.who[1:] == answers.who[:-1]) & (landed.extra[1:] == landed.extra[:-1])
    twice = np.flatnonzero(same) + 1
    return [
        Finding(
            Check.LANDINGS,
            f"{_particle(int(answers.who[k]))} is paid again in tick {answers.tick[k]}",
            int(answers.tick[k]),
            int(answers.tick[k]),
        )
        for k in twice[:_SHOWN].tolist()
    ]


def _soil(what: int) -> str:
    return f"soil {what >> 8} with {what & 0xFF} % of moisture"


def _particle(who: int) -> str:
    return f"machine {who >> 32}'s particle {who & 0xFFFFFFFF}"
