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
from msg_bridge.audit.audit_window import (
    Window,
    check_completeness,
    find_audit_window,
    order_all_streams,
)
from msg_bridge.audit.collect import RunData, StreamKey, collect_messages
from msg_bridge.audit.deposit_requests import audit_backlogs, audit_deposit_requests
from msg_bridge.audit.membership import SoilTicks, build_timeline, find_release_rows
from msg_bridge.audit.numbered_rows import NumberedRows
from msg_bridge.audit.report import AuditReport, Check, CheckResult, Finding, RunReport
from msg_bridge.audit.terrain_volume import audit_terrain
from msg_bridge.bag.reader import BagReader
from msg_bridge.contract.messages import Stream
from msg_bridge.contract.rows import ConversionKind

__all__ = ["AuditReport", "audit_bag", "audit_run"]


def audit_bag(path: str | Path, progress: Callable[[float], None] | None = None) -> AuditReport:
    """Audit a bag.

    Args:
        path: a folder with metadata.yaml, a folder of .mcap files, or one such file.
        progress: told now and then which part [0, 1] is read.

    Raises:
        BagReadError: it cannot be read.
    """
    reader = BagReader(path)
    gathered = collect_messages(reader, progress)
    findings = [
        Finding(Check.COMPLETENESS, f"{name} breaks off; what came after is lost")
        for name in reader.truncated
    ]
    findings += gathered.findings
    if not gathered.runs:
        text = "the bag has no rows, headers or terrain maps: there is nothing to audit"
        findings.append(Finding(Check.COMPLETENESS, text))
    runs = [audit_run(number, data) for number, data in gathered.runs.items()]
    return AuditReport(str(path), gathered.messages, reader.truncated, tuple(runs), tuple(findings))


def audit_run(run_id: int, data: RunData) -> RunReport:
    """Audit one run."""
    if not data.soil:
        why = "the bag has no soil headers (/soil/tick) of this epoch"
        none = tuple(CheckResult(check, False, why) for check in Check)
        return RunReport(run_id, checks=none, findings=tuple(data.findings))
    soil = SoilTicks.of(data)
    timeline = build_timeline(soil, data)
    streams = order_all_streams(soil, timeline, data)
    window = find_audit_window(soil, timeline, data, streams)
    absent = _find_missing_streams(soil, window, streams, data)
    findings = check_completeness(soil, timeline, data, streams, window, absent)
    conversions = streams[Stream.CONVERSION, 0, 0]
    released = find_release_rows(soil, timeline, conversions)
    terrain = audit_terrain(
        soil,
        window,
        conversions,
        streams[Stream.MAP_UPDATE, 0, 0],
        data.keyframes,
        has_map_updates=Stream.MAP_UPDATE not in absent,
    )
    checks, result = [_completeness_result(window, soil, absent)], AccountsAudit()
    if Stream.CONVERSION in absent:
        why = "the bag has no conversion rows"
        named = (
            Check.TERRAIN,
            Check.KEYFRAMES,
            Check.ACCOUNTS,
            Check.LEDGER,
            Check.DEPOSIT_REQUESTS,
        )
        checks += [CheckResult(check, False, why) for check in (*named, Check.BACKLOG)]
    else:
        result = audit_accounts(
            soil, window, timeline, conversions, released, terrain.totals, data.ledgers
        )
        landings, wrong = audit_deposit_requests(
            soil,
            window,
            timeline,
            data,
            streams,
            released,
            has_deposit_requests=Stream.DEPOSIT_REQUEST not in absent,
        )
        backlog, wrong_owed = audit_backlogs(window, timeline, streams)
        checks += [*terrain.checks, *result.checks, landings, backlog]
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
    worst = max_imbalance_tick = None
    if result.imbalance is not None:
        at = int(np.argmax(np.abs(result.imbalance)))
        worst, max_imbalance_tick = int(result.imbalance[at]), int(ticks[at])
    return RunReport(
        run_id,
        recorded,
        audited,
        rows=_count_rows(streams, lambda each: each.numbers.size),
        duplicates=_count_rows(streams, lambda each: each.duplicates),
        moved_mm3=_moved_volumes(soil, window, conversions, released),
        keyframes=terrain.keyframes,
        start_mm3=result.start,
        max_imbalance_mm3=worst,
        max_imbalance_tick=max_imbalance_tick,
        checks=tuple(checks),
        findings=tuple(findings),
        notes=tuple(notes),
    )


def _find_missing_streams(
    soil: SoilTicks, window: Window, streams: dict[StreamKey, NumberedRows], data: RunData
) -> set[Stream]:
    """Streams that headers count rows of and the bag has none of: not recorded at all."""
    counted = {stream: spans.total for stream, spans in soil.spans.items()}
    for stream in (Stream.SWEEP, Stream.DEPOSIT_REQUEST):
        ranges = [
            header.sweeps if stream is Stream.SWEEP else header.deposit_requests
            for steps in data.steps.values()
            for header in steps.values()
        ]
        counted[stream] = sum(each.count for each in ranges)
    there = {key[0] for key, rows in streams.items() if rows.numbers.size}
    return {stream for stream, count in counted.items() if count and stream not in there}


def _completeness_result(window: Window, soil: SoilTicks, absent: set[Stream]) -> CheckResult:
    ticks = soil.ticks[window.indices]
    detail = f"ticks {ticks[0]}..{ticks[-1]}, headers and numbered rows"
    if absent:
        names = ", ".join(sorted(stream.name for stream in absent))
        detail = f"the bag has no {names} rows, which its headers count"
    return CheckResult(Check.COMPLETENESS, not absent, detail)


def _count_rows(
    streams: dict[StreamKey, NumberedRows], count: Callable[[NumberedRows], int]
) -> dict[str, int]:
    """Some count of all streams of each kind; streams without rows are left out."""
    tally: dict[str, int] = {}
    for (stream, _, _), rows in streams.items():
        if rows.numbers.size:
            tally[stream.name] = tally.get(stream.name, 0) + count(rows)
    return tally


def _moved_volumes(
    soil: SoilTicks, window: Window, conversions: NumberedRows, released: NDArray[np.bool_]
) -> dict[str, int]:
    """Volume of conversions in the window, by kind."""
    span = soil.spans[Stream.CONVERSION]
    low, high = span.first[window.first], span.last[window.last]
    inside = (conversions.numbers >= low) & (conversions.numbers <= high)
    rows = conversions.rows[inside]
    volume = rows["volume_mm3"].astype(np.int64)
    moved = {kind.name: int(volume[rows["kind"] == kind].sum()) for kind in ConversionKind}
    return {**moved, "RELEASED": int(volume[released[inside]].sum())}
