"""A sound bag passes; checks that lack messages are reported as not made."""

from pathlib import Path

import numpy as np
import pytest
from std_msgs.msg import String
from support.audit_reports import failed_checks, finding_texts, has_tick
from support.recorded_exchange import ScriptedMachine, recorded_dig, scripted_run
from support.recorded_messages import Recording, machine_topic

from msg_bridge.audit import bag_audit as audit_module
from msg_bridge.audit.bag_audit import audit_bag
from msg_bridge.audit.numbered_rows import Spans, order_rows
from msg_bridge.audit.report import Check
from msg_bridge.bag.reader import BagReadError
from msg_bridge.contract.messages import RowRange, Stream
from msg_bridge.contract.rows import MAP_UPDATE, ConversionKind, Rows, empty_rows

TICKS = 60  # of the recording


def test_recording_passes_with_its_volumes(recording, audit) -> None:
    report = audit(recording)
    (run,) = report.runs
    assert report.passed, [f.text for f in run.findings]
    assert run.max_imbalance_mm3 == 0
    assert (run.audited, run.ticks) == ((0, TICKS), TICKS + 1)
    assert {check.check for check in run.checks if check.done} == set(Check)
    assert run.keyframes == 4
    rows = recording.rows(Stream.CONVERSION)
    assert run.rows["CONVERSION"] == rows.size
    for kind in ConversionKind:
        volumes = rows["volume_mm3"][rows["kind"] == kind].astype(np.int64)
        assert volumes.size
        assert run.moved_mm3[kind.name] == volumes.sum()


def test_digging_machine_passes(tmp_path: Path) -> None:
    report = audit_bag(recorded_dig(120).write_folder(tmp_path / "bag"))
    assert report.passed
    assert report.runs[0].moved_mm3["EXCAVATE"] > 10**7


def test_bag_of_a_killed_recorder_is_balanced_and_does_not_pass(recording, tmp_path: Path) -> None:
    report = audit_bag(recording.write_folder(tmp_path / "bag", finish=False))
    assert report.truncated == ("bag_0.mcap",)
    assert report.balanced
    assert not report.passed
    assert report.runs[0].ticks > 10


def test_audit_does_not_import_the_code_that_it_checks() -> None:
    modules = [p for p in Path(audit_module.__file__).parent.glob("*.py") if p.stem != "__init__"]
    assert len(modules) > 5
    for path in modules:
        assert "msg_bridge.exchange" not in path.read_text()


def test_run_with_machines_that_leave_rejoin_and_crash_passes(audit) -> None:
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
    assert run.soil_endpoint.ledger.absent > 0
    released = run.release_ended(2)
    for _ in range(5):
        run.step()
    run.keyframe()
    report = audit(run.recording)
    assert report.passed, report.runs[0].findings
    assert report.runs[0].moved_mm3["RELEASED"] == released > 0
    assert run.soil_endpoint.ledger.absent == 0
    assert report.runs[0].rows["BACKLOG"] > 0


def test_machine_that_was_restarted_with_a_lower_session_id_passes(audit) -> None:
    run = scripted_run(2)
    for session_id in (10**6, 10):  # random in each process; particle ids begin at 1
        for _ in range(10):
            run.step()
        run.crash(2, ScriptedMachine(9, y=0.5), session_id=session_id)
    for _ in range(10):
        run.step()
    run.keyframe()
    report = audit(run.recording)
    assert report.passed, report.runs[0].findings


@pytest.mark.parametrize("has_ticks", [True, False])
def test_run_in_which_another_process_took_the_place_of_a_machine_passes(
    audit, has_ticks: bool
) -> None:
    run = scripted_run(2)
    for _ in range(10):
        run.step()
    machine, end = run.simulated_machines[2], run.machine_endpoints[2]
    run.crash(2, ScriptedMachine(9, y=0.5), session_id=100)
    for _ in range(10 if has_ticks else 1):
        run.step()
    run.simulated_machines[2], run.machine_endpoints[2] = machine, end
    for _ in range(2):  # the first session ends before a tick of it
        run.soil_endpoint.drop(2)
        end.abandon_session()
        run.step()
        run.rejoin(2, **machine.totals)
    for _ in range(10):
        run.step()
    assert (run.soil_endpoint.ledger.absent > 0) is has_ticks
    if has_ticks:
        run.release_ended(2)
    assert run.soil_endpoint.ledger.absent == 0
    run.step()
    run.keyframe()
    report = audit(run.recording)
    assert report.passed, report.runs[0].findings


def test_simulation_in_a_namespace_is_audited_by_its_namespace(recording, tmp_path: Path) -> None:
    messages = [(f"/site_a{topic}", time, message) for topic, time, message in recording.messages]
    path = Recording([*messages, *recording.messages]).write(tmp_path / "a.mcap")
    for namespace in ("/", "/site_a"):
        report = audit_bag(path, namespace=namespace)
        assert report.passed
        assert report.messages == len(recording.messages)
    with pytest.raises(BagReadError, match="namespaces /, /site_a;"):
        audit_bag(path)
    for namespace in ("/site_a/excavator", "/site_b"):
        with pytest.raises(BagReadError, match=f"no simulation in .*{namespace};.* in /, /site_a"):
            audit_bag(path, namespace=namespace)


def test_only_simulation_of_a_bag_is_audited_in_any_namespace(recording, tmp_path: Path) -> None:
    messages = [(f"/site_a{topic}", time, message) for topic, time, message in recording.messages]
    report = audit_bag(Recording(messages).write(tmp_path / "a.mcap"))
    assert report.passed
    assert report.runs[0].ticks == TICKS + 1


def test_retransmitted_messages_are_no_fault(recording, audit) -> None:
    repeated = recording.copy()
    repeated.messages = [each for each in repeated.messages for _ in range(2)]
    report = audit(repeated)
    assert report.passed
    assert report.runs[0].duplicates["CONVERSION"] == report.runs[0].rows["CONVERSION"]


def test_order_of_messages_between_topics_does_not_matter(recording, audit) -> None:
    delays = np.random.default_rng(0).integers(0, 50, len(recording.messages))
    delayed = [
        (topic, time + 1000 * int(delay), message)
        for (topic, time, message), delay in zip(recording.messages, delays, strict=True)
    ]
    assert audit(Recording(delayed)).passed


def test_each_run_is_audited_separately(audit) -> None:
    run = scripted_run()
    for _ in range(10):
        run.step()
    run.keyframe()
    second = scripted_run(run_id=2, recording=run.recording)
    for _ in range(20):
        second.step()
    second.keyframe()
    report = audit(run.recording)
    assert report.passed
    assert [(run.run_id, run.ticks) for run in report.runs] == [(1, 11), (2, 21)]


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
def test_checks_without_their_topic_are_not_made(recording, audit, topic, unchecked) -> None:
    report = audit(recording.without(topic))
    (run,) = report.runs
    assert {each.check for each in run.unchecked} == unchecked
    assert failed_checks(report) == set()
    assert not report.passed


def test_imbalance_is_unknown_without_terrain_conversions_or_headers(recording, audit) -> None:
    for topic in ("/terrain/map", "/soil/conversions", "/soil/tick"):
        assert audit(recording.without(topic)).runs[0].max_imbalance_mm3 is None


def test_missing_machine_headers_are_a_fault(recording, audit) -> None:
    report = audit(recording.without(machine_topic(1, "soil_tick")))
    assert "machine 1's headers of ticks 1..60" in finding_texts(report, Check.COMPLETENESS)
    assert not report.balanced


def test_bag_that_begins_in_the_middle_is_audited_from_there(recording, audit) -> None:
    begin = recording.find("/soil/tick", has_tick(18)) + 1
    report = audit(Recording(recording.messages[begin:]))
    (run,) = report.runs
    assert failed_checks(report) == set()
    assert run.max_imbalance_mm3 == 0
    # Rows of tick 18, which are missing, are acknowledged only in tick 20.
    assert run.audited == (20, TICKS)
    (unchecked,) = run.unchecked
    assert unchecked.check is Check.ACCOUNTS
    assert report.balanced
    assert not report.passed


def test_error_of_1_mm3_is_found_in_a_bag_that_begins_in_the_middle(recording, audit) -> None:
    begin = recording.find("/soil/tick", has_tick(19)) + 1
    part = Recording(recording.messages[begin:])
    rows = part.rows(Stream.CONVERSION)
    number = int(rows["seq"][(rows["tick"] == 45) & (rows["kind"] == ConversionKind.EXCAVATE)][0])

    def change(rows: Rows) -> Rows:
        rows["volume_mm3"][rows["seq"] == number] -= 1
        return rows

    report = audit(part.modify_rows(Stream.CONVERSION, change, number=number))
    assert {Check.TERRAIN, Check.ACCOUNTS, Check.LEDGER} <= failed_checks(report)


def test_bag_without_exchange_messages_does_not_pass(audit) -> None:
    recording = Recording()
    recording.add("/chatter", String(data="hello"))
    report = audit(recording)
    assert not report.passed
    assert [finding.check for finding in report.findings] == [Check.COMPLETENESS]


def test_row_numbers_wrap_at_2_to_the_32() -> None:
    first = 2**32 - 2
    rows = empty_rows(MAP_UPDATE, 5)
    rows["seq"] = (first + np.arange(5)) % 2**32
    ordered = order_rows(Stream.MAP_UPDATE, [rows[:2], rows[1:4], rows[4:]], first)
    assert ordered.numbers.tolist() == list(range(first, first + 5))
    assert ordered.duplicates == 1
    spans = Spans.of([1, 2], [RowRange(first, 3), RowRange(first + 3, 3)])
    assert spans.missing(ordered) == [(first + 5, first + 5)]
