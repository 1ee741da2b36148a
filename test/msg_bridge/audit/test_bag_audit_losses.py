"""Where a bag lost messages, the audit reports unknown ticks, no false sum and no false error."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pytest
from support.audit_reports import failed_checks
from support.recorded_messages import TOPICS, Recording, machine_topic

from msg_bridge.audit.report import AuditReport, Check
from msg_bridge.contract.messages import Stream

Audit = Callable[[Recording], AuditReport]

LEDGER, SOIL_HEADER = "/soil/ledger", "/soil/tick"
MACHINE_HEADER = machine_topic(1, "soil_tick")
CONVERSIONS = TOPICS[Stream.CONVERSION]
EXCHANGE = (*TOPICS.values(), LEDGER, SOIL_HEADER, MACHINE_HEADER)


def without_ticks(
    recording: Recording, topics: Sequence[str], *ticks: tuple[int, int]
) -> Recording:
    """Return a copy without the messages of some topics in ranges of ticks."""
    ends = [k for k, each in enumerate(recording.messages) if each[0] == LEDGER]
    lost = {k for first, last in ticks for k in range(ends[first - 1] + 1, ends[last] + 1)}
    return Recording(
        [
            each
            for k, each in enumerate(recording.messages)
            if k not in lost or each[0] not in topics
        ]
    )


def checks_of(report: AuditReport) -> dict[Check, str]:
    """Return the detail of each check of the only run that was not made in full."""
    (run,) = report.runs
    return {each.check: each.detail for each in run.unchecked}


@pytest.mark.parametrize(
    "topics",
    [
        EXCHANGE,
        (CONVERSIONS,),
        (TOPICS[Stream.MAP_UPDATE],),
        (TOPICS[Stream.DEPOSIT_REQUEST],),
        (CONVERSIONS, LEDGER),
        (CONVERSIONS, MACHINE_HEADER),
        (CONVERSIONS, SOIL_HEADER),
    ],
    ids=lambda topics: "+".join(each.rsplit("/", 1)[1] for each in topics)[:60],
)
def test_ticks_with_lost_rows_are_unknown_and_no_error(
    recording: Recording, audit: Audit, topics: Sequence[str]
) -> None:
    report = audit(without_ticks(recording, topics, (23, 26)))
    assert failed_checks(report) == {Check.COMPLETENESS}
    assert not report.passed
    (run,) = report.runs
    assert run.max_imbalance_mm3 == 0
    assert "unknown from tick 2" in checks_of(report)[Check.ACCOUNTS]
    assert any("unknown from tick 2" in note for note in run.notes)


def test_each_range_of_lost_rows_is_named(recording: Recording, audit: Audit) -> None:
    report = audit(without_ticks(recording, [CONVERSIONS], (12, 13), (45, 45)))
    assert failed_checks(report) == {Check.COMPLETENESS}
    detail = checks_of(report)[Check.ACCOUNTS]
    assert "unknown from tick 12 to 1" in detail
    assert "and from tick 45 to 4" in detail


@pytest.mark.parametrize("topic", [LEDGER, SOIL_HEADER, MACHINE_HEADER, TOPICS[Stream.SWEEP]])
def test_lost_headers_ledgers_and_sweeps_leave_all_sums_known(
    recording: Recording, audit: Audit, topic: str
) -> None:
    report = audit(without_ticks(recording, [topic], (23, 26), (45, 45)))
    assert failed_checks(report) == {Check.COMPLETENESS}
    assert report.runs[0].max_imbalance_mm3 == 0
    assert not checks_of(report)


def test_error_behind_lost_rows_is_still_found(recording: Recording, audit: Audit) -> None:
    number = int(recording.rows(Stream.CONVERSION)["seq"][-20])

    def change(rows):  # type: ignore[no-untyped-def]
        rows["volume_mm3"][rows["seq"] == number] += 1
        return rows

    modified = recording.modify_rows(Stream.CONVERSION, change, number=number)
    report = audit(without_ticks(modified, [CONVERSIONS], (12, 13)))
    assert {Check.TERRAIN, Check.LEDGER} <= failed_checks(report)
