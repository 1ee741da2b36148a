"""A sound bag is found sound, and of what cannot be checked nothing is claimed."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from std_msgs.msg import String
from support.bag_recording import Recording, machine_topic
from support.bag_scenes import ScriptedMachine, recorded_dig, scripted_run

from msg_bridge.audit import audit as audit_module
from msg_bridge.audit.audit import audit_bag
from msg_bridge.audit.report import AuditReport, Check
from msg_bridge.audit.streams import Spans, numbered
from msg_bridge.contract.messages import RowRange, Stream, Verb
from msg_bridge.contract.rows import CHANGED, Kind, Rows, empty_rows

TICKS = 60


@pytest.fixture(scope="module")
def recording() -> Recording:
    run = scripted_run(keyframe_every=20)
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
    found = [f for epoch in report.epochs for f in epoch.findings if f.check is check]
    return "\n".join(f.text for f in found)


def failed(report: AuditReport) -> set[Check]:
    return {f.check for epoch in report.epochs for f in epoch.findings}


def of_tick(tick: int) -> Callable[[object], bool]:
    return lambda header: (
        getattr(header, "tick", None) == tick
        and (getattr(header, "verb", Verb.STEP) is not Verb.JOIN)
    )


# Sound bags


def test_a_recorded_dig_is_sound_to_the_last_mm3(recording, audit) -> None:
    report = audit(recording)
    (epoch,) = report.epochs
    assert report.sound, [f.text for f in epoch.findings]
    assert epoch.worst_imbalance_mm3 == 0
    assert (epoch.audited, epoch.ticks) == ((0, TICKS), TICKS + 1)
    assert {check.check for check in epoch.checks if check.done} == set(Check)
    assert epoch.keyframes == 4
    rows = recording.rows(Stream.CONVERSION)
    assert epoch.rows["CONVERSION"] == rows.size
    for kind in Kind:
        own = rows["volume_mm3"][rows["kind"] == kind].astype(np.int64)
        assert own.size
        assert epoch.moved_mm3[kind.name] == own.sum()


def test_a_real_machine_that_digs_is_sound(tmp_path: Path) -> None:
    report = audit_bag(recorded_dig(120).write_folder(tmp_path / "bag"))
    assert report.sound
    assert report.epochs[0].moved_mm3["EXCAVATE"] > 10**7


def test_what_a_killed_recorder_left_is_balanced_and_not_called_whole(
    recording, tmp_path: Path
) -> None:
    report = audit_bag(recording.write_folder(tmp_path / "bag", finish=False))
    assert report.truncated == ("bag_0.mcap",)
    assert report.balanced
    assert not report.sound
    assert report.epochs[0].ticks > 10


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
    run.come_back(2, **run.parties[2].totals)
    for _ in range(10):
        run.step()
    run.crash(2, ScriptedMachine(9, y=0.5))
    for _ in range(10):
        run.step()
    run.keyframe()
    report = audit(run.recording)
    assert report.sound, report.epochs[0].findings
    assert run.soil_end.ledger.absent > 0
    assert report.epochs[0].rows["OWED"] > 0


def test_resent_rows_and_headers_are_no_fault(recording, audit) -> None:
    again = recording.copy()
    again.messages = [each for each in again.messages for _ in range(2)]
    report = audit(again)
    assert report.sound
    assert report.epochs[0].repeats["CONVERSION"] == report.epochs[0].rows["CONVERSION"]


def test_messages_out_of_order_between_topics_are_no_fault(recording, audit) -> None:
    times = np.random.default_rng(0).integers(0, 50, len(recording.messages))
    late = [
        (topic, time + 1000 * int(delay), message)
        for (topic, time, message), delay in zip(recording.messages, times, strict=True)
    ]
    assert audit(Recording(late)).sound


def test_each_run_between_resets_is_audited_on_its_own(audit) -> None:
    run = scripted_run()
    for _ in range(10):
        run.step()
    run.keyframe()
    again = scripted_run(epoch=2, recording=run.recording)
    for _ in range(20):
        again.step()
    again.keyframe()
    report = audit(run.recording)
    assert report.sound
    assert [(epoch.epoch, epoch.ticks) for epoch in report.epochs] == [(1, 11), (2, 21)]


# What cannot be checked


@pytest.mark.parametrize(
    ("topic", "unchecked"),
    [
        ("/terrain/map", {Check.TERRAIN, Check.KEYFRAMES, Check.ACCOUNTS, Check.LEDGER}),
        ("/terrain/changes", {Check.COMPLETENESS, Check.TERRAIN, Check.KEYFRAMES}),
        ("/soil/landed", {Check.COMPLETENESS, Check.LANDINGS}),
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
    (epoch,) = report.epochs
    assert {each.check for each in epoch.unchecked} == unchecked
    assert failed(report) == set()
    assert not report.sound


def test_without_terrain_or_conversions_no_imbalance_is_claimed(recording, audit) -> None:
    for topic in ("/terrain/map", "/soil/conversions", "/soil/tick"):
        assert audit(recording.without(topic)).epochs[0].worst_imbalance_mm3 is None


def test_without_machine_headers_the_bag_is_not_sound(recording, audit) -> None:
    report = audit(recording.without(machine_topic(1, "soil_tick")))
    assert "machine 1's headers of 1..60 are missing" in texts(report, Check.COMPLETENESS)
    assert not report.balanced


def test_a_bag_that_begins_in_the_middle_is_audited_from_there_and_said_so(
    recording, audit
) -> None:
    begin = recording.find("/soil/tick", of_tick(18)) + 1
    report = audit(Recording(recording.messages[begin:]))
    (epoch,) = report.epochs
    assert failed(report) == set()
    assert epoch.worst_imbalance_mm3 == 0
    # Rows of tick 18, which it lacks, are acknowledged in tick 20 only.
    assert epoch.audited == (20, TICKS)
    (unchecked,) = epoch.unchecked
    assert unchecked.check is Check.ACCOUNTS
    assert "from tick 20 on only" in unchecked.detail
    assert report.balanced
    assert not report.sound


def test_one_mm3_is_found_in_a_bag_that_begins_in_the_middle(recording, audit) -> None:
    begin = recording.find("/soil/tick", of_tick(19)) + 1
    part = Recording(recording.messages[begin:])
    rows = part.rows(Stream.CONVERSION)
    number = int(rows["seq"][(rows["tick"] == 45) & (rows["kind"] == Kind.EXCAVATE)][0])

    def change(rows: Rows) -> Rows:
        rows["volume_mm3"][rows["seq"] == number] -= 1
        return rows

    report = audit(part.tamper_rows(Stream.CONVERSION, change, number=number))
    assert {Check.TERRAIN, Check.ACCOUNTS, Check.LEDGER} <= failed(report)


def test_a_bag_without_anything_of_the_exchange_is_not_sound(audit) -> None:
    recording = Recording()
    recording.add("/chatter", String(data="hello"))
    report = audit(recording)
    assert not report.sound
    assert "nothing to audit" in report.findings[0].text


def test_numbers_that_begin_anew_at_two_to_the_32_go_on() -> None:
    first = 2**32 - 2
    rows = empty_rows(CHANGED, 5)
    rows["seq"] = (first + np.arange(5)) % 2**32
    found = numbered(Stream.CHANGED, [rows[:2], rows[1:4], rows[4:]], first)
    assert found.numbers.tolist() == list(range(first, first + 5))
    assert found.repeats == 1
    spans = Spans.of([1, 2], [RowRange(first, 3), RowRange(first + 3, 3)])
    assert spans.missing(found) == [(first + 5, first + 5)]
    assert spans.lacking(found).tolist() == [False, True]
