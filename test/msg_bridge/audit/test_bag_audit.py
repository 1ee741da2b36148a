"""A sound bag is found sound, and of what cannot be checked nothing is claimed."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from std_msgs.msg import String
from support.recorded_exchange import ScriptedMachine, recorded_dig, scripted_run
from support.recorded_messages import Recording, machine_topic

from msg_bridge.audit import bag_audit as audit_module
from msg_bridge.audit.bag_audit import audit_bag
from msg_bridge.audit.numbered_rows import Spans, order_rows
from msg_bridge.audit.report import AuditReport, Check
from msg_bridge.contract.messages import RowRange, Stream, Verb
from msg_bridge.contract.rows import MAP_UPDATE, ConversionKind, Rows, empty_rows

TICKS = 60


@pytest.fixture(scope="module")
def recording() -> Recording:
    run = scripted_run(map_interval_ticks=20)
    for _ in range(TICKS):
        run.step()
    return run.recording


@pytest.fixture
def audit(tmp_path: Path) -> Callable[[Recording], AuditReport]:
    def write_and_audit(recording: Recording, **options: object) -> AuditReport:
        return audit_bag(recording.write(tmp_path / "a.mcap", **options))

    return write_and_audit


def texts(report: AuditReport, check: Check) -> str:
    """What a check found."""
    found = [f for run_id in report.runs for f in run_id.findings if f.check is check]
    return "\n".join(f.text for f in found)


def failed(report: AuditReport) -> set[Check]:
    return {f.check for run_id in report.runs for f in run_id.findings}


def of_tick(tick: int) -> Callable[[object], bool]:
    return lambda header: (
        getattr(header, "tick", None) == tick
        and (getattr(header, "verb", Verb.STEP) is not Verb.JOIN)
    )


# Sound bags


def test_a_recorded_dig_is_sound_to_the_last_mm3(recording, audit) -> None:
    report = audit(recording)
    (run_id,) = report.runs
    assert report.passed, [f.text for f in run_id.findings]
    assert run_id.max_imbalance_mm3 == 0
    assert (run_id.audited, run_id.ticks) == ((0, TICKS), TICKS + 1)
    assert {check.check for check in run_id.checks if check.done} == set(Check)
    assert run_id.keyframes == 4
    rows = recording.rows(Stream.CONVERSION)
    assert run_id.rows["CONVERSION"] == rows.size
    for kind in ConversionKind:
        own = rows["volume_mm3"][rows["kind"] == kind].astype(np.int64)
        assert own.size
        assert run_id.moved_mm3[kind.name] == own.sum()


def test_a_real_machine_that_digs_is_sound(tmp_path: Path) -> None:
    report = audit_bag(recorded_dig(120).write_folder(tmp_path / "bag"))
    assert report.passed
    assert report.runs[0].moved_mm3["EXCAVATE"] > 10**7


def test_what_a_killed_recorder_left_is_balanced_and_not_called_whole(
    recording, tmp_path: Path
) -> None:
    report = audit_bag(recording.write_folder(tmp_path / "bag", finish=False))
    assert report.truncated == ("bag_0.mcap",)
    assert report.balanced
    assert not report.passed
    assert report.runs[0].ticks > 10


def test_the_audit_knows_nothing_of_the_accounts_that_it_checks() -> None:
    modules = [p for p in Path(audit_module.__file__).parent.glob("*.py") if p.stem != "__init__"]
    assert len(modules) > 5
    for path in modules:
        assert "msg_bridge.exchange" not in path.read_text()


def test_machines_that_leave_return_and_crash_keep_it_sound(audit) -> None:
    run = scripted_run(2)
    for _ in range(20):
        run.step()
    run.step(leaving=[2])
    for _ in range(5):
        run.step()
    run.rejoin(2, **run.simulated_machines[2].totals)
    for _ in range(10):
        run.step()
    run.crash(2, ScriptedMachine(9, y=0.5))
    for _ in range(10):
        run.step()
    run.keyframe()
    report = audit(run.recording)
    assert report.passed, report.runs[0].findings
    assert run.soil_endpoint.ledger.absent > 0
    assert report.runs[0].rows["BACKLOG"] > 0


def test_resent_rows_and_headers_are_no_fault(recording, audit) -> None:
    again = recording.copy()
    again.messages = [each for each in again.messages for _ in range(2)]
    report = audit(again)
    assert report.passed
    assert report.runs[0].duplicates["CONVERSION"] == report.runs[0].rows["CONVERSION"]


def test_messages_out_of_order_between_topics_are_no_fault(recording, audit) -> None:
    times = np.random.default_rng(0).integers(0, 50, len(recording.messages))
    late = [
        (topic, time + 1000 * int(delay), message)
        for (topic, time, message), delay in zip(recording.messages, times, strict=True)
    ]
    assert audit(Recording(late)).passed


def test_each_run_between_resets_is_audited_on_its_own(audit) -> None:
    run = scripted_run()
    for _ in range(10):
        run.step()
    run.keyframe()
    again = scripted_run(run_id=2, recording=run.recording)
    for _ in range(20):
        again.step()
    again.keyframe()
    report = audit(run.recording)
    assert report.passed
    assert [(run_id.run_id, run_id.ticks) for run_id in report.runs] == [(1, 11), (2, 21)]


# What cannot be checked


@pytest.mark.parametrize(
    ("topic", "unchecked"),
    [
        ("/terrain/map", {Check.TERRAIN, Check.KEYFRAMES, Check.ACCOUNTS, Check.LEDGER}),
        ("/terrain/map_updates", {Check.COMPLETENESS, Check.TERRAIN, Check.KEYFRAMES}),
        ("/soil/deposit_requests", {Check.COMPLETENESS, Check.DEPOSIT_REQUESTS}),
        ("/soil/ledger", {Check.LEDGER}),
        ("/soil/tool_sweeps", {Check.COMPLETENESS}),
        ("/soil/conversions", set(Check)),
        ("/soil/tick", set(Check)),
    ],
)
def test_what_a_bag_that_lacks_a_topic_cannot_show_is_said(
    recording, audit, topic, unchecked
) -> None:
    report = audit(recording.without(topic))
    (run_id,) = report.runs
    assert {each.check for each in run_id.unchecked} == unchecked
    assert failed(report) == set()
    assert not report.passed


def test_without_terrain_or_conversions_no_imbalance_is_claimed(recording, audit) -> None:
    for topic in ("/terrain/map", "/soil/conversions", "/soil/tick"):
        assert audit(recording.without(topic)).runs[0].max_imbalance_mm3 is None


def test_without_machine_headers_the_bag_is_not_sound(recording, audit) -> None:
    report = audit(recording.without(machine_topic(1, "soil_tick")))
    assert "machine 1's headers of 1..60 are missing" in texts(report, Check.COMPLETENESS)
    assert not report.balanced


def test_a_bag_that_begins_in_the_middle_is_audited_from_there_and_said_so(
    recording, audit
) -> None:
    begin = recording.find("/soil/tick", of_tick(18)) + 1
    report = audit(Recording(recording.messages[begin:]))
    (run_id,) = report.runs
    assert failed(report) == set()
    assert run_id.max_imbalance_mm3 == 0
    # Rows of tick 18, which it lacks, are acknowledged in tick 20 only.
    assert run_id.audited == (20, TICKS)
    (unchecked,) = run_id.unchecked
    assert unchecked.check is Check.ACCOUNTS
    assert "from tick 20 on only" in unchecked.detail
    assert report.balanced
    assert not report.passed


def test_one_mm3_is_found_in_a_bag_that_begins_in_the_middle(recording, audit) -> None:
    begin = recording.find("/soil/tick", of_tick(19)) + 1
    part = Recording(recording.messages[begin:])
    rows = part.rows(Stream.CONVERSION)
    number = int(rows["seq"][(rows["tick"] == 45) & (rows["kind"] == ConversionKind.EXCAVATE)][0])

    def change(rows: Rows) -> Rows:
        rows["volume_mm3"][rows["seq"] == number] -= 1
        return rows

    report = audit(part.modify_rows(Stream.CONVERSION, change, number=number))
    assert {Check.TERRAIN, Check.ACCOUNTS, Check.LEDGER} <= failed(report)


def test_a_bag_without_anything_of_the_exchange_is_not_sound(audit) -> None:
    recording = Recording()
    recording.add("/chatter", String(data="hello"))
    report = audit(recording)
    assert not report.passed
    assert "nothing to audit" in report.findings[0].text


def test_numbers_that_begin_anew_at_two_to_the_32_go_on() -> None:
    first = 2**32 - 2
    rows = empty_rows(MAP_UPDATE, 5)
    rows["seq"] = (first + np.arange(5)) % 2**32
    found = order_rows(Stream.MAP_UPDATE, [rows[:2], rows[1:4], rows[4:]], first)
    assert found.numbers.tolist() == list(range(first, first + 5))
    assert found.duplicates == 1
    spans = Spans.of([1, 2], [RowRange(first, 3), RowRange(first + 3, 3)])
    assert spans.missing(found) == [(first + 5, first + 5)]
    assert spans.lacking(found).tolist() == [False, True]
