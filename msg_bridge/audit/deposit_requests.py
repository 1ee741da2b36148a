"""Match deposit requests with their answers one to one, and backlogs with the rows they copy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from msg_bridge.audit.audit_window import Window
from msg_bridge.audit.collect import RunData, StreamKey
from msg_bridge.audit.membership import (
    UNKNOWN_TICK,
    MembershipChange,
    MembershipEvent,
    MembershipTimeline,
)
from msg_bridge.audit.numbered_rows import NumberedRows, Numbers
from msg_bridge.audit.report import Check, CheckResult, Finding
from msg_bridge.audit.soil_ticks import SoilTicks
from msg_bridge.audit.streams import accepted_spans
from msg_bridge.contract.messages import Stream
from msg_bridge.contract.rows import CONVERSION, ConversionKind, Rows

__all__ = ["audit_backlogs", "audit_deposit_requests"]

_MAX_FINDINGS = 10  # of one kind that have a finding of their own


class _ParticleRecords(NamedTuple):
    """Deposit requests or answers, sorted by machine and particle, shape (n,) each.

    Attributes:
        particle_key: machine id (upper 32 bits) and particle id (lower 32 bits).
        volume: [mm^3].
        tick: soil tick in which it was accepted or answered; UNKNOWN_TICK if unknown.
        extra: of a request the session in which the particle numbers began, of an answer its kind.
        material: soil id (upper bits) and moisture [%] (lower 8 bits).
    """

    particle_key: Numbers
    volume: Numbers
    tick: Numbers
    extra: Numbers
    material: Numbers

    def where(self, keep: NDArray[np.bool_]) -> _ParticleRecords:
        """Return the selected records."""
        return _ParticleRecords(*(values[keep] for values in self))


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
    """Match each deposit request of the audited ticks with its answer.

    Args:
        soil, window, timeline, data, streams: the run.
        released: which conversion rows released soil of absent machines, shape (rows,).
        has_deposit_requests: whether deposit requests were recorded, or headers count none.
    """
    if not has_deposit_requests:
        return CheckResult(Check.DEPOSIT_REQUESTS, False, "the bag has no deposit requests"), []
    answers = _answer_records(soil, window, streams[StreamKey(Stream.CONVERSION)], released)
    requests = _request_records(soil, window, timeline, data, streams)
    keys, index = np.unique(
        np.concatenate([answers.particle_key, requests.particle_key]), return_inverse=True
    )
    num_answers = np.bincount(index[: answers.particle_key.size], minlength=keys.size)
    num_requests = np.bincount(index[answers.particle_key.size :], minlength=keys.size)
    findings = _find_unmatched(answers, requests, keys, num_answers - num_requests)
    matched = keys[num_answers == num_requests]
    answers = answers.where(np.isin(answers.particle_key, matched))
    requests = requests.where(np.isin(requests.particle_key, matched))
    findings += _find_unequal_answers(answers, requests)
    findings += _find_duplicate_deposits(answers, requests)
    detail = f"{requests.particle_key.size} requests, each answered"
    return CheckResult(Check.DEPOSIT_REQUESTS, True, detail), findings


def audit_backlogs(
    window: Window,
    timeline: MembershipTimeline,
    streams: Mapping[StreamKey, NumberedRows],
) -> tuple[CheckResult, list[Finding]]:
    """Compare the rows sent to machines that rejoined with the conversion rows they lacked."""
    findings: list[Finding] = []
    num_checked = 0
    missing = set()
    for events in timeline.events[: window.last + 1]:
        for event in events:
            if event.change is not MembershipChange.JOINED or not event.backlog:
                continue
            if event.header is None:
                continue
            is_copy = _is_backlog_copy(event, event.header.conversions_received, streams)
            if is_copy is None:
                missing.add(event.session.machine_id)
                continue
            num_checked += event.backlog
            if not is_copy:
                machine_id = event.session.machine_id
                text = f"the backlog of machine {machine_id} is not a copy of the rows it lacks"
                findings.append(Finding(Check.BACKLOG, text))
    if missing:
        names = ", ".join(str(machine_id) for machine_id in sorted(missing))
        detail = f"those of machine {names} are not all in the bag"
        return CheckResult(Check.BACKLOG, False, detail), findings
    detail = f"{num_checked} row(s)" if num_checked else "none"
    return CheckResult(Check.BACKLOG, True, detail), findings


def _is_backlog_copy(
    event: MembershipEvent, received: int, streams: Mapping[StreamKey, NumberedRows]
) -> bool | None:
    """Return whether the backlog of a join copies the rows after `received`.

    None if the bag lacks some of either.
    """
    conversions = streams[StreamKey(Stream.CONVERSION)]
    backlog = streams.get(StreamKey(Stream.BACKLOG, *event.session))
    rows = conversions.rows
    first = int(conversions.numbers[0]) if rows.size else 2**62
    if backlog is None or backlog.numbers.size < event.backlog or first > received + 1 > 1:
        return None
    lacked = (rows["machine_id"] == event.session.machine_id) & (conversions.numbers > received)
    expected = rows[lacked][: event.backlog]
    # Compare bytes, since a coordinate may be NaN; `seq` numbers the rows of each stream.
    names = [name for name in CONVERSION.names or () if name != "seq"]
    return expected.size == backlog.rows.size and all(
        expected[name].tobytes() == backlog.rows[name].tobytes() for name in names
    )


def _answer_records(
    soil: SoilTicks, window: Window, conversions: NumberedRows, released: NDArray[np.bool_]
) -> _ParticleRecords:
    span = soil.spans[Stream.CONVERSION]
    low, high = int(span.first[window.first]), int(span.last[window.last])
    is_answer = (conversions.rows["kind"] != ConversionKind.EXCAVATE) & ~released
    is_answer &= (conversions.numbers >= low) & (conversions.numbers <= high)
    rows = conversions.rows[is_answer]
    tick = span.tick_of(conversions.numbers[is_answer])
    return _sort_by_particle(rows, tick, rows["kind"].astype(np.int64))


def _request_records(
    soil: SoilTicks,
    window: Window,
    timeline: MembershipTimeline,
    data: RunData,
    streams: Mapping[StreamKey, NumberedRows],
) -> _ParticleRecords:
    low, high = int(soil.ticks[window.first]), int(soil.ticks[window.last])
    parts = []
    # In the order in which they began: session ids are random in each process, and particle ids
    # begin at 1.
    for session in timeline.accepted:
        stream = streams[StreamKey(Stream.DEPOSIT_REQUEST, *session)]
        spans = accepted_spans(timeline, data, session, Stream.DEPOSIT_REQUEST)
        ticks = timeline.soil_ticks(session)
        index = np.minimum(np.searchsorted(spans.last, stream.numbers), spans.ticks.size - 1)
        counted = (stream.numbers >= spans.first[index]) & (stream.numbers <= spans.last[index])
        # Rows between two spans belong to headers that the bag lacks.
        audited = np.flatnonzero((ticks >= low) & (ticks <= high))
        if not audited.size:
            continue
        in_session = (stream.numbers >= spans.first[audited[0]]) & (
            stream.numbers <= spans.last[audited[-1]]
        )
        tick = np.where(counted, ticks[index], UNKNOWN_TICK)
        keep = in_session & ((tick == UNKNOWN_TICK) | ((tick >= low) & (tick <= high)))
        numbering = timeline.numbering_session[session]
        numbering_session = np.full(int(keep.sum()), numbering, dtype=np.int64)
        parts.append((stream.rows[keep], tick[keep], numbering_session))
    if not parts:
        empty = np.zeros(0, dtype=np.int64)
        return _ParticleRecords(empty, empty, empty, empty, empty)
    rows, tick, numbering_session = (np.concatenate(each) for each in zip(*parts, strict=True))
    return _sort_by_particle(rows, tick, numbering_session)


def _sort_by_particle(rows: Rows, tick: Numbers, extra: Numbers) -> _ParticleRecords:
    """Return records by machine and particle; those of one particle keep their order in time."""
    key = rows["machine_id"].astype(np.int64) << 32 | rows["particle_id"]
    order = np.argsort(key, kind="stable")
    volume = rows["volume_mm3"].astype(np.int64)
    material = rows["soil"].astype(np.int64) << 8 | rows["moisture"]
    return _ParticleRecords(key[order], volume[order], tick[order], extra[order], material[order])


def _find_unmatched(
    answers: _ParticleRecords, requests: _ParticleRecords, keys: Numbers, excess: Numbers
) -> list[Finding]:
    """Find particles with more or fewer answers than requests.

    Args:
        answers, requests: the records.
        keys: the particles, shape (n,).
        excess: number of answers minus number of requests of each, shape (n,).
    """
    findings = []
    for key in keys[excess > 0][:_MAX_FINDINGS].tolist():
        tick = int(answers.tick[answers.particle_key == key][-1])
        text = f"{_particle_name(key)} has more answers than deposit requests (tick {tick})"
        findings.append(Finding(Check.DEPOSIT_REQUESTS, text, tick, tick))
    for key in keys[excess < 0][:_MAX_FINDINGS].tolist():
        tick = int(requests.tick[requests.particle_key == key][-1])
        text = f"the deposit request of {_particle_name(key)} has no answer (tick {tick})"
        known_tick = None if tick == UNKNOWN_TICK else tick
        findings.append(Finding(Check.DEPOSIT_REQUESTS, text, known_tick, known_tick))
    num_unmatched = int(np.count_nonzero(excess))
    if num_unmatched > 2 * _MAX_FINDINGS:
        text = f"{num_unmatched} particles in all have no answer or too many"
        findings.append(Finding(Check.DEPOSIT_REQUESTS, text))
    return findings


def _find_unequal_answers(answers: _ParticleRecords, requests: _ParticleRecords) -> list[Finding]:
    """Find answers with another volume, material or tick than their requests."""
    volume = np.flatnonzero(answers.volume != requests.volume)
    material = np.flatnonzero(answers.material != requests.material)
    tick = np.flatnonzero((requests.tick != UNKNOWN_TICK) & (answers.tick != requests.tick))
    texts = [
        (k, f"of {requests.volume[k]} mm3 was answered with {answers.volume[k]} mm3")
        for k in volume[:_MAX_FINDINGS].tolist()
    ]
    texts += [
        (
            k,
            f"of {_material_name(int(requests.material[k]))} was answered with"
            f" {_material_name(int(answers.material[k]))}",
        )
        for k in material[:_MAX_FINDINGS].tolist()
    ]
    texts += [
        (k, f"of tick {requests.tick[k]} was answered") for k in tick[:_MAX_FINDINGS].tolist()
    ]
    findings = []
    for k, text in texts:
        particle, at = _particle_name(int(answers.particle_key[k])), int(answers.tick[k])
        text = f"the deposit request of {particle} {text} in tick {at}"
        findings.append(Finding(Check.DEPOSIT_REQUESTS, text, at, at))
    num_more = max(volume.size, material.size, tick.size) - _MAX_FINDINGS
    if num_more > 0:
        text = f"{num_more} more deposit requests have a wrong answer"
        findings.append(Finding(Check.DEPOSIT_REQUESTS, text))
    return findings


def _find_duplicate_deposits(
    answers: _ParticleRecords, requests: _ParticleRecords
) -> list[Finding]:
    """Find particles that were deposited again after they became terrain or left the map."""
    done = (answers.extra == ConversionKind.DEPOSIT) | (answers.extra == ConversionKind.OUTSIDE)
    answers, requests = answers.where(done), requests.where(done)
    same_particle = answers.particle_key[1:] == answers.particle_key[:-1]
    same_numbering = requests.extra[1:] == requests.extra[:-1]
    findings = []
    for k in (np.flatnonzero(same_particle & same_numbering) + 1)[:_MAX_FINDINGS].tolist():
        tick = int(answers.tick[k])
        text = f"{_particle_name(int(answers.particle_key[k]))} is deposited again in tick {tick}"
        findings.append(Finding(Check.DEPOSIT_REQUESTS, text, tick, tick))
    return findings


def _material_name(material: int) -> str:
    return f"soil {material >> 8} with {material & 0xFF} % of moisture"


def _particle_name(key: int) -> str:
    return f"machine {key >> 32}'s particle {key & 0xFFFFFFFF}"
