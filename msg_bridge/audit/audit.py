"""The whole audit: read, follow, recompute, compare.

Rows, headers and terrain maps are taken at their word and compared with one another; the ledger
that the soil published is only compared with, never used, unless the bag begins in the middle of
a run. The modules beside this one are its steps::

    gather -> follow machines through the ticks -> window, gaps -> terrain -> accounts -> landings
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msg_bridge.audit.accounts import AccountsAudit, audit_accounts
from msg_bridge.audit.gather import EpochData, StreamKey, gather
from msg_bridge.audit.landings import audit_landings, audit_owed
from msg_bridge.audit.report import AuditReport, Check, CheckResult, EpochReport, Finding
from msg_bridge.audit.streams import NumberedRows
from msg_bridge.audit.terrain import audit_terrain
from msg_bridge.audit.ticks import SoilTicks, follow, released_rows
from msg_bridge.audit.window import Window, completeness, number_streams, window_of
from msg_bridge.bag.reader import BagReader
from msg_bridge.contract.messages import Stream
from msg_bridge.contract.rows import Kind

__all__ = ["AuditReport", "audit_bag", "audit_epoch"]


def audit_bag(path: str | Path, progress: Callable[[float], None] | None = None) -> AuditReport:
    """Audit a bag.

    Args:
        path: a folder with metadata.yaml, a folder of .mcap files, or one such file.
        progress: told now and then which part [0, 1] is read.

    Raises:
        BagReadError: it cannot be read.
    """
    reader = BagReader(path)
    gathered = gather(reader, progress)
    findings = [
        Finding(Check.COMPLETENESS, f"{name} breaks off; what came after is lost")
        for name in reader.truncated
    ]
    findings += gathered.findings
    if not gathered.epochs:
        text = "the bag has no rows, headers or terrain maps: there is nothing to audit"
        findings.append(Finding(Check.COMPLETENESS, text))
    epochs = [audit_epoch(number, data) for number, data in gathered.epochs.items()]
    return AuditReport(
        str(path), gathered.messages, reader.truncated, tuple(epochs), tuple(findings)
    )


def audit_epoch(epoch: int, data: EpochData) -> EpochReport:
    """Audit one run."""
    if not data.soil:
        why = "the bag has no soil headers (/soil/tick) of this epoch"
        none = tuple(CheckResult(check, False, why) for check in Check)
        return EpochReport(epoch, checks=none, findings=tuple(data.findings))
    soil = SoilTicks.of(data)
    story = follow(soil, data)
    streams = number_streams(soil, story, data)
    window = window_of(soil, story, data, streams)
    absent = _absent(soil, window, streams, data)
    findings = completeness(soil, story, data, streams, window, absent)
    conversions = streams[Stream.CONVERSION, 0, 0]
    released = released_rows(soil, story, conversions)
    terrain = audit_terrain(
        soil,
        window,
        conversions,
        streams[Stream.CHANGED, 0, 0],
        data.keyframes,
        has_changes=Stream.CHANGED not in absent,
    )
    checks, result = [_complete(window, soil, absent)], AccountsAudit()
    if Stream.CONVERSION in absent:
        why = "the bag has no conversion rows"
        named = (Check.TERRAIN, Check.KEYFRAMES, Check.ACCOUNTS, Check.LEDGER, Check.LANDINGS)
        checks += [CheckResult(check, False, why) for check in (*named, Check.OWED)]
    else:
        result = audit_accounts(
            soil, window, story, conversions, released, terrain.totals, data.ledgers
        )
        landings, wrong = audit_landings(
            soil, window, story, data, streams, released, has_landed=Stream.LANDED not in absent
        )
        owed, wrong_owed = audit_owed(window, story, streams)
        checks += [*terrain.checks, *result.checks, landings, owed]
        findings += [*terrain.findings, *result.findings, *wrong, *wrong_owed]
    ticks = soil.ticks[window.indices]
    recorded = (int(soil.ticks[0]), int(soil.ticks[-1]))
    audited = (int(ticks[0]), int(ticks[-1]))
    notes = list(result.notes)
    if recorded != audited:
        notes.append(
            f"ticks {recorded[0]}..{recorded[1]} are recorded; those before {audited[0]} and after"
            f" {audited[1]} are incomplete and were not audited"
        )
    worst = worst_tick = None
    if result.imbalance is not None:
        at = int(np.argmax(np.abs(result.imbalance)))
        worst, worst_tick = int(result.imbalance[at]), int(ticks[at])
    return EpochReport(
        epoch,
        recorded,
        audited,
        rows=_tally(streams, lambda each: each.numbers.size),
        repeats=_tally(streams, lambda each: each.repeats),
        moved_mm3=_moved(soil, window, conversions, released),
        keyframes=terrain.keyframes,
        start_mm3=result.start,
        worst_imbalance_mm3=worst,
        worst_tick=worst_tick,
        checks=tuple(checks),
        findings=tuple(findings),
        notes=tuple(notes),
    )


def _absent(
    soil: SoilTicks, window: Window, streams: dict[StreamKey, NumberedRows], data: EpochData
) -> set[Stream]:
    """Streams that headers count rows of and the bag has none of: not recorded at all."""
    counted = {stream: spans.total for stream, spans in soil.spans.items()}
    for stream in (Stream.SWEEP, Stream.LANDED):
        ranges = [
            header.sweeps if stream is Stream.SWEEP else header.landed
            for steps in data.steps.values()
            for header in steps.values()
        ]
        counted[stream] = sum(each.count for each in ranges)
    there = {key[0] for key, rows in streams.items() if rows.numbers.size}
    return {stream for stream, count in counted.items() if count and stream not in there}


def _complete(window: Window, soil: SoilTicks, absent: set[Stream]) -> CheckResult:
    ticks = soil.ticks[window.indices]
    detail = f"ticks {ticks[0]}..{ticks[-1]}, headers and numbered rows"
    if absent:
        names = ", ".join(sorted(stream.name for stream in absent))
        detail = f"the bag has no {names} rows, which its headers count"
    return CheckResult(Check.COMPLETENESS, not absent, detail)


def _tally(
    streams: dict[StreamKey, NumberedRows], count: Callable[[NumberedRows], int]
) -> dict[str, int]:
    """Some count of all streams of each kind; streams without rows are left out."""
    tally: dict[str, int] = {}
    for (stream, _, _), rows in streams.items():
        if rows.numbers.size:
            tally[stream.name] = tally.get(stream.name, 0) + count(rows)
    return tally


def _moved(
    soil: SoilTicks, window: Window, conversions: NumberedRows, released: NDArray[np.bool_]
) -> dict[str, int]:
    """Volume of conversions in the window, by kind."""
    span = soil.spans[Stream.CONVERSION]
    low, high = span.first[window.first], span.last[window.last]
    inside = (conversions.numbers >= low) & (conversions.numbers <= high)
    rows = conversions.rows[inside]
    volume = rows["volume_mm3"].astype(np.int64)
    moved = {kind.name: int(volume[rows["kind"] == kind].sum()) for kind in Kind}
    return {**moved, "RELEASED": int(volume[released[inside]].sum())}
