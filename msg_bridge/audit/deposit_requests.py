"""Landed rows and their answers, matched one to one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msg_bridge.audit.audit_window import Window
from msg_bridge.audit.collect import RunData, StreamKey
from msg_bridge.audit.membership import (
    UNKNOWN_TICK,
    MembershipChange,
    MembershipTimeline,
    SoilTicks,
)
from msg_bridge.audit.numbered_rows import NumberedRows, Numbers
from msg_bridge.audit.report import Check, CheckResult, Finding
from msg_bridge.contract.messages import Stream
from msg_bridge.contract.rows import CONVERSION, ConversionKind, Rows

__all__ = ["audit_backlogs", "audit_deposit_requests"]

_MAX_FINDINGS = 10


@dataclass(frozen=True)
class _ParticleRecords:
    """Landed rows or answers, by source, particle and order, shape (n,).

    Attributes:
        who: source and particle in one number.
        volume: [mm^3].
        tick: soil tick in which it was taken or given; UNKNOWN_TICK if not known.
        extra: the life in which the particle's numbers began, or the kind of answer.
        what: its soil and its moisture in one number.
    """

    particle_key: Numbers
    volume: Numbers
    tick: Numbers
    extra: Numbers
    what: Numbers

    def where(self, keep: NDArray[np.bool_]) -> _ParticleRecords:
        fields = (self.particle_key, self.volume, self.tick, self.extra, self.what)
        return _ParticleRecords(*(each[keep] for each in fields))


def audit_deposit_requests(
    soil: SoilTicks,
    window: Window,
    timeline: MembershipTimeline,
    data: RunData,
    streams: Mapping[StreamKey, NumberedRows],
    released: NDArray[np.bool_],
    *,
    has_deposit_requests: bool,
) -> tuple[CheckResult, list[Finding]]:
    """Match them.

    Args:
        released: which conversion rows put down what an absent machine left.
        has_deposit_requests: whether the bag has the topic of landed rows, or needs none.
    """
    if not has_deposit_requests:
        return CheckResult(Check.DEPOSIT_REQUESTS, False, "the bag has no landed rows"), []
    span = soil.spans[Stream.CONVERSION]
    conversions = streams[Stream.CONVERSION, 0, 0]
    low, high = int(span.first[window.first]), int(span.last[window.last])
    answers = _answer_records(soil, conversions, released, low, high)
    landed = _request_records(soil, window, timeline, data, streams)
    findings = []
    names, index = np.unique(
        np.concatenate([answers.particle_key, landed.particle_key]), return_inverse=True
    )
    given = np.bincount(index[: answers.particle_key.size], minlength=names.size)
    asked = np.bincount(index[answers.particle_key.size :], minlength=names.size)
    for who in names[given > asked][:_MAX_FINDINGS].tolist():
        text = f"{_particle_label(who)} is answered more often than it landed"
        tick = int(answers.tick[answers.particle_key == who][-1])
        findings.append(Finding(Check.DEPOSIT_REQUESTS, f"{text} (tick {tick})", tick, tick))
    for who in names[asked > given][:_MAX_FINDINGS].tolist():
        tick = int(landed.tick[landed.particle_key == who][-1])
        text = f"{_particle_label(who)} landed and was not answered"
        place = None if tick == UNKNOWN_TICK else tick
        findings.append(Finding(Check.DEPOSIT_REQUESTS, f"{text} (tick {tick})", place, place))
    uneven = int((given != asked).sum())
    if uneven > 2 * _MAX_FINDINGS:
        findings.append(
            Finding(Check.DEPOSIT_REQUESTS, f"{uneven} particles in all are answered wrongly")
        )
    answers = answers.where(np.isin(answers.particle_key, names[given == asked]))
    landed = landed.where(np.isin(landed.particle_key, names[given == asked]))
    findings += _find_unequal_answers(answers, landed)
    findings += _find_duplicate_deposits(answers, landed)
    return CheckResult(
        Check.DEPOSIT_REQUESTS, True, f"{landed.particle_key.size} landings, each answered"
    ), findings


def audit_backlogs(
    window: Window,
    timeline: MembershipTimeline,
    streams: Mapping[StreamKey, NumberedRows],
) -> tuple[CheckResult, list[Finding]]:
    """Rows sent to machines that came back: copies of those they lacked."""
    conversions = streams[Stream.CONVERSION, 0, 0]
    findings, checked = [], 0
    missing = []
    names = [name for name in CONVERSION.names or () if name != "seq"]
    for events in timeline.events[: window.last + 1]:
        for event in events:
            header, machine_id = event.header, event.session_id[0]
            if event.change is MembershipChange.JOINED and event.backlog and header is not None:
                through = header.conversions_received
                backlog = streams.get((Stream.BACKLOG, *event.session_id))
                rows = conversions.rows
                begins = int(conversions.numbers[0]) if rows.size else 2**62
                if (
                    backlog is None
                    or backlog.numbers.size < event.backlog
                    or begins > through + 1 > 1
                ):
                    missing.append(machine_id)
                    continue
                due = (rows["machine_id"] == machine_id) & (conversions.numbers > through)
                expected = rows[due][: event.backlog]
                checked += event.backlog
                same = expected.size == backlog.rows.size and all(
                    # Bit by bit, since a place may be no number; seq is of their own stream.
                    expected[name].tobytes() == backlog.rows[name].tobytes()
                    for name in names
                )
                if not same:
                    text = f"the rows owed to machine {machine_id} are not those it lacks"
                    findings.append(Finding(Check.BACKLOG, text))
    if missing:
        told = ", ".join(str(machine_id) for machine_id in sorted(set(missing)))
        detail = f"those of machine {told} are not all in the bag"
        return CheckResult(Check.BACKLOG, False, detail), findings
    return CheckResult(Check.BACKLOG, True, f"{checked} row(s)" if checked else "none"), findings


def _answer_records(
    soil: SoilTicks, conversions: NumberedRows, released: NDArray[np.bool_], low: int, high: int
) -> _ParticleRecords:
    rows = conversions.rows
    answers = (rows["kind"] != ConversionKind.EXCAVATE) & ~released
    answers &= (conversions.numbers >= low) & (conversions.numbers <= high)
    own = rows[answers]
    tick = soil.spans[Stream.CONVERSION].tick_of(conversions.numbers[answers])
    return _sort_by_particle(own, tick, own["kind"].astype(np.int64))


def _request_records(
    soil: SoilTicks,
    window: Window,
    timeline: MembershipTimeline,
    data: RunData,
    streams: Mapping[StreamKey, NumberedRows],
) -> _ParticleRecords:
    low, high = int(soil.ticks[window.first]), int(soil.ticks[window.last])
    sides = []
    for session_id in sorted(timeline.accepted):
        stream = streams[(Stream.DEPOSIT_REQUEST, *session_id)]
        spans, ticks = (
            timeline.spans(data, session_id, Stream.DEPOSIT_REQUEST),
            timeline.soil_ticks(session_id),
        )
        at = np.minimum(np.searchsorted(spans.last, stream.numbers), spans.ticks.size - 1)
        counted = (stream.numbers >= spans.first[at]) & (stream.numbers <= spans.last[at])
        # Rows between two headers are of headers that the bag lacks.
        between = (stream.numbers >= spans.first[0]) & (stream.numbers <= spans.last[-1])
        tick = np.where(counted, ticks[at], UNKNOWN_TICK)
        keep = between & ((tick == UNKNOWN_TICK) | ((tick >= low) & (tick <= high)))
        numbering_session = np.full(
            int(keep.sum()), timeline.numbering_session[session_id], dtype=np.int64
        )
        sides.append((stream.rows[keep], tick[keep], numbering_session))
    if not sides:
        nothing = np.zeros(0, dtype=np.int64)
        return _ParticleRecords(nothing, nothing, nothing, nothing, nothing)
    rows, tick, numbering_session = (np.concatenate(parts) for parts in zip(*sides, strict=True))
    return _sort_by_particle(rows, tick, numbering_session)


def _sort_by_particle(rows: Rows, tick: Numbers, extra: Numbers) -> _ParticleRecords:
    who = rows["machine_id"].astype(np.int64) << 32 | rows["particle_id"]
    order = np.argsort(who, kind="stable")
    volume = rows["volume_mm3"].astype(np.int64)
    what = rows["soil"].astype(np.int64) << 8 | rows["moisture"]
    return _ParticleRecords(who[order], volume[order], tick[order], extra[order], what[order])


def _find_unequal_answers(answers: _ParticleRecords, landed: _ParticleRecords) -> list[Finding]:
    """Answers of another volume or soil, or in another tick, than their landings."""
    findings = []
    volume = np.flatnonzero(answers.volume != landed.volume)
    later = (landed.tick != UNKNOWN_TICK) & (answers.tick != landed.tick)
    for k in volume[:_MAX_FINDINGS].tolist():
        tick = int(answers.tick[k])
        text = (
            f"{_particle_label(int(answers.particle_key[k]))} landed with {landed.volume[k]} mm3 and was answered"
            f" with {answers.volume[k]} mm3 in tick {tick}"
        )
        findings.append(Finding(Check.DEPOSIT_REQUESTS, text, tick, tick))
    soil = np.flatnonzero(answers.what != landed.what)
    for k in soil[:_MAX_FINDINGS].tolist():
        tick = int(answers.tick[k])
        text = (
            f"{_particle_label(int(answers.particle_key[k]))} landed as {_soil_label(int(landed.what[k]))} and was"
            f" answered as {_soil_label(int(answers.what[k]))} in tick {tick}"
        )
        findings.append(Finding(Check.DEPOSIT_REQUESTS, text, tick, tick))
    for k in np.flatnonzero(later)[:_MAX_FINDINGS].tolist():
        tick = int(answers.tick[k])
        name = _particle_label(int(answers.particle_key[k]))
        text = f"{name} landed in tick {landed.tick[k]} and was answered in tick {tick}"
        findings.append(Finding(Check.DEPOSIT_REQUESTS, text, tick, tick))
    more = max(volume.size, soil.size, int(later.sum())) - _MAX_FINDINGS
    if more > 0:
        findings.append(
            Finding(Check.DEPOSIT_REQUESTS, f"{more} more landings have a wrong answer")
        )
    return findings


def _find_duplicate_deposits(answers: _ParticleRecords, landed: _ParticleRecords) -> list[Finding]:
    """Particles that landed again after they had become terrain or had left the map."""
    paid = (answers.extra == ConversionKind.DEPOSIT) | (answers.extra == ConversionKind.OUTSIDE)
    answers, landed = answers.where(paid), landed.where(paid)
    same = (answers.particle_key[1:] == answers.particle_key[:-1]) & (
        landed.extra[1:] == landed.extra[:-1]
    )
    twice = np.flatnonzero(same) + 1
    return [
        Finding(
            Check.DEPOSIT_REQUESTS,
            f"{_particle_label(int(answers.particle_key[k]))} is paid again in tick {answers.tick[k]}",
            int(answers.tick[k]),
            int(answers.tick[k]),
        )
        for k in twice[:_MAX_FINDINGS].tolist()
    ]


def _soil_label(what: int) -> str:
    return f"soil {what >> 8} with {what & 0xFF} % of moisture"


def _particle_label(who: int) -> str:
    return f"machine {who >> 32}'s particle {who & 0xFFFFFFFF}"
