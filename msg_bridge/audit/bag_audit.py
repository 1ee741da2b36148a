"""Audit a bag: read, reconstruct, recompute, compare.

Rows, headers and terrain maps are compared with one another. The ledger that the soil published is
only compared with, never used, unless the bag begins in the middle of a run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msg_bridge.audit.accounts import AccountsAudit, audit_accounts
from msg_bridge.audit.audit_window import Window, find_audit_window
from msg_bridge.audit.collect import RunData, StreamKey, collect_messages
from msg_bridge.audit.completeness import check_completeness
from msg_bridge.audit.deposit_requests import audit_backlogs, audit_deposit_requests
from msg_bridge.audit.membership import build_timeline
from msg_bridge.audit.numbered_rows import NumberedRows
from msg_bridge.audit.released_rows import find_released_rows
from msg_bridge.audit.report import AuditReport, Check, CheckResult, Finding, RunReport
from msg_bridge.audit.segments import (
    describe_unknown_ticks,
    join_check_results,
    split_at_losses,
)
from msg_bridge.audit.soil_ticks import SoilTicks
from msg_bridge.audit.streams import find_missing_streams, order_all_streams
from msg_bridge.audit.terrain_volume import audit_terrain
from msg_bridge.bag.reader import BagReader
from msg_bridge.contract.messages import Stream
from msg_bridge.contract.rows import ConversionKind

__all__ = ["AuditReport", "audit_bag", "audit_run"]


def audit_bag(
    path: str | Path,
    progress: Callable[[float], None] | None = None,
    *,
    namespace: str | None = None,
) -> AuditReport:
    """Audit all runs of a bag.

    Args:
        path: a folder with metadata.yaml, a folder of .mcap files, or one such file.
        progress: called now and then with the fraction read [0..1].
        namespace: that of the simulation to audit; needed if the bag has several.

    Raises:
        BagReadError: it cannot be read, or has several simulations, or none in this namespace.
    """
    reader = BagReader(path, namespace=namespace)
    reader.check_simulation()
    collected = collect_messages(reader, progress)
    findings = [
        Finding(Check.COMPLETENESS, f"{name} has no end; what came after its last chunk is lost")
        for name in reader.truncated
    ]
    findings += collected.findings
    if not collected.runs:
        text = "the bag has no rows, headers or terrain maps: there is nothing to audit"
        findings.append(Finding(Check.COMPLETENESS, text))
    runs = tuple(audit_run(run_id, data) for run_id, data in collected.runs.items())
    return AuditReport(str(path), collected.messages, reader.truncated, runs, tuple(findings))


def audit_run(run_id: int, data: RunData) -> RunReport:
    """Audit one run."""
    if not data.soil:
        why = "the bag has no soil headers (/soil/tick) of this run"
        unchecked = tuple(CheckResult(check, False, why) for check in Check)
        return RunReport(run_id, checks=unchecked, findings=tuple(data.findings))
    soil = SoilTicks.of(data)
    timeline = build_timeline(soil, data)
    streams = order_all_streams(soil, timeline, data)
    window = find_audit_window(soil, timeline, data, streams)
    absent = find_missing_streams(soil, streams, data)
    conversions = streams[StreamKey(Stream.CONVERSION)]
    released = find_released_rows(soil, timeline, conversions)
    findings = check_completeness(soil, timeline, data, streams, window, absent)
    checks = [_completeness_result(window, soil, absent)]
    parts = [
        _audit_part(each, absent)
        for each in split_at_losses(soil, timeline, data, streams, window, absent)
    ]
    ticks = soil.ticks[window.indices]
    recorded = (int(soil.ticks[0]), int(soil.ticks[-1]))
    audited = (int(ticks[0]), int(ticks[-1]))
    unknown = describe_unknown_ticks(audited, [each.audited for each in parts])
    checks += join_check_results([each.checks for each in parts], unknown)
    for each in parts:
        findings += each.findings
    max_imbalance, max_imbalance_tick = _max_imbalance(parts)
    return RunReport(
        run_id,
        recorded,
        audited,
        rows=_count_rows(streams, lambda each: each.numbers.size),
        duplicates=_count_rows(streams, lambda each: each.duplicates),
        moved_mm3=_moved_volumes(soil, window, conversions, released),
        keyframes=sum(each.keyframes for each in parts),
        start_mm3=parts[0].accounts.start,
        max_imbalance_mm3=max_imbalance,
        max_imbalance_tick=max_imbalance_tick,
        checks=tuple(checks),
        findings=tuple(findings),
        notes=_notes(recorded, audited, unknown),
    )


@dataclass
class _PartAudit:
    """Audit of a part of a run without lost rows.

    Attributes:
        ticks: the audited soil ticks, shape (n,).
        accounts: audit of the accounts.
        keyframes: number of checked terrain maps.
        checks, findings: extent of all checks but COMPLETENESS, and their faults.
    """

    ticks: NDArray[np.int64]
    accounts: AccountsAudit
    keyframes: int
    checks: list[CheckResult]
    findings: list[Finding]

    @property
    def audited(self) -> tuple[int, int]:
        """First and last audited soil tick."""
        return int(self.ticks[0]), int(self.ticks[-1])


def _audit_part(data: RunData, absent: set[Stream]) -> _PartAudit:
    """Audit everything but the completeness of a part of a run."""
    soil = SoilTicks.of(data)
    timeline = build_timeline(soil, data)
    streams = order_all_streams(soil, timeline, data)
    window = find_audit_window(soil, timeline, data, streams)
    conversions = streams[StreamKey(Stream.CONVERSION)]
    released = find_released_rows(soil, timeline, conversions)
    terrain = audit_terrain(
        soil,
        window,
        conversions,
        streams[StreamKey(Stream.MAP_UPDATE)],
        data.keyframes,
        has_map_updates=Stream.MAP_UPDATE not in absent,
    )
    ticks = soil.ticks[window.indices]
    if Stream.CONVERSION in absent:
        why = "the bag has no conversion rows"
        checks = [CheckResult(c, False, why) for c in Check if c is not Check.COMPLETENESS]
        return _PartAudit(ticks, AccountsAudit(), terrain.keyframes, checks, [])
    accounts = audit_accounts(
        soil, window, timeline, conversions, released, terrain.totals, data.ledgers
    )
    requests, request_findings = audit_deposit_requests(
        soil,
        window,
        timeline,
        data,
        streams,
        released,
        has_deposit_requests=Stream.DEPOSIT_REQUEST not in absent,
    )
    backlogs, backlog_findings = audit_backlogs(window, timeline, streams)
    return _PartAudit(
        ticks,
        accounts,
        terrain.keyframes,
        [*terrain.checks, *accounts.checks, requests, backlogs],
        [*terrain.findings, *accounts.findings, *request_findings, *backlog_findings],
    )


def _completeness_result(window: Window, soil: SoilTicks, absent: set[Stream]) -> CheckResult:
    ticks = soil.ticks[window.indices]
    detail = f"ticks {ticks[0]}..{ticks[-1]}, headers and numbered rows"
    if absent:
        names = ", ".join(sorted(stream.name for stream in absent))
        detail = f"the bag has no {names} rows, which its headers count"
    return CheckResult(Check.COMPLETENESS, not absent, detail)


def _max_imbalance(parts: Sequence[_PartAudit]) -> tuple[int | None, int | None]:
    """Return the largest imbalance [mm^3] and its tick; None if it was not computed."""
    largest: tuple[int | None, int | None] = (None, None)
    for each in parts:
        if each.accounts.imbalance is not None:
            index = int(np.argmax(np.abs(each.accounts.imbalance)))
            imbalance = int(each.accounts.imbalance[index])
            if largest[0] is None or abs(imbalance) > abs(largest[0]):
                largest = imbalance, int(each.ticks[index])
    return largest


def _notes(recorded: tuple[int, int], audited: tuple[int, int], unknown: str) -> tuple[str, ...]:
    notes = []
    if recorded != audited:
        notes.append(
            f"ticks {recorded[0]}..{recorded[1]} are recorded; those before {audited[0]} and after"
            f" {audited[1]} are incomplete and were not audited"
        )
    if unknown:
        notes.append(f"rows were lost: where soil was is {unknown}")
    return tuple(notes)


def _count_rows(
    streams: dict[StreamKey, NumberedRows], count: Callable[[NumberedRows], int]
) -> dict[str, int]:
    """Sum a count over the streams of each kind; streams without rows are left out."""
    totals: dict[str, int] = {}
    for (stream, _, _), rows in streams.items():
        if rows.numbers.size:
            totals[stream.name] = totals.get(stream.name, 0) + count(rows)
    return totals


def _moved_volumes(
    soil: SoilTicks, window: Window, conversions: NumberedRows, released: NDArray[np.bool_]
) -> dict[str, int]:
    """Return the volume of the conversions in the window [mm^3], by kind."""
    span = soil.spans[Stream.CONVERSION]
    low, high = span.first[window.first], span.last[window.last]
    inside = (conversions.numbers >= low) & (conversions.numbers <= high)
    rows = conversions.rows[inside]
    volume = rows["volume_mm3"].astype(np.int64)
    moved = {kind.name: int(volume[rows["kind"] == kind].sum()) for kind in ConversionKind}
    return {**moved, "RELEASED": int(volume[released[inside]].sum())}
