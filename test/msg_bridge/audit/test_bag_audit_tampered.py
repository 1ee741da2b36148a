"""Whatever is done to a sound bag is found, and named with its place."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.lib.recfunctions import repack_fields
from support.recorded_exchange import scripted_run
from support.recorded_messages import Recording, machine_topic

from msg_bridge.audit.bag_audit import audit_bag
from msg_bridge.audit.report import AuditReport, Check
from msg_bridge.codec.point_cloud import from_point_cloud, to_byte_array, to_point_cloud
from msg_bridge.codec.row_chunks import chunk_dtype
from msg_bridge.codec.terrain import TERRAIN_CELL
from msg_bridge.codec.tick_headers import from_multi_array, to_multi_array
from msg_bridge.contract.messages import MachineHeader, SoilHeader, Stream, Verb
from msg_bridge.contract.rows import ConversionKind, Rows

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


def change_header(recording: Recording, index: int, **values: object) -> Recording:
    spoilt = recording.copy()
    topic, time, message = spoilt.messages[index]
    header = dataclasses.replace(from_multi_array(message), **values)
    spoilt.messages[index] = (topic, time, to_multi_array(header))
    return spoilt


def of_tick(tick: int) -> Callable[[object], bool]:
    return lambda header: (
        getattr(header, "tick", None) == tick
        and (getattr(header, "verb", Verb.STEP) is not Verb.JOIN)
    )


def alter(field: str, by: int, where: int = 0) -> Callable[[Rows], Rows]:
    def change(rows: Rows) -> Rows:
        rows[field][where] += by
        return rows

    return change


def numbers_of(recording: Recording, stream: Stream, kind: ConversionKind) -> list[int]:
    """Numbers of conversion rows that are the first of their message and of a kind."""
    rows = recording.rows(stream)
    return rows["seq"][rows["kind"] == kind].tolist()


def tick_of(recording: Recording, number: int) -> int:
    rows = recording.rows(Stream.CONVERSION)
    return int(rows["tick"][rows["seq"] == number][0])


def test_a_dropped_conversion_row_is_a_gap_with_its_tick(recording, audit) -> None:
    number = numbers_of(recording, Stream.CONVERSION, ConversionKind.EXCAVATE)[100]
    spoilt = recording.modify_rows(
        Stream.CONVERSION, lambda rows: rows[rows["seq"] != number], number=number
    )
    report = audit(spoilt)
    tick = tick_of(recording, number)
    assert f"CONVERSION row {number} is missing (tick {tick})" in texts(report, Check.COMPLETENESS)
    assert report.runs[0].max_imbalance_mm3 != 0
    assert not report.passed


def test_a_conversion_row_booked_twice_is_found(recording, audit) -> None:
    number = numbers_of(recording, Stream.CONVERSION, ConversionKind.DEPOSIT)[10]

    def double(rows: Rows) -> Rows:
        row = rows[rows["seq"] == number]
        row["seq"] += 1
        return np.concatenate([rows, row])

    report = audit(recording.modify_rows(Stream.CONVERSION, double, number=number))
    assert "came twice with different content" in texts(report, Check.COMPLETENESS)
    assert not report.passed


def test_a_particle_answered_twice_is_found(recording, audit) -> None:
    number = numbers_of(recording, Stream.CONVERSION, ConversionKind.DEPOSIT)[10]
    rows = recording.rows(Stream.CONVERSION)
    row = rows[rows["seq"] == number][0]
    other = next(
        int(r["seq"])
        for r in rows[rows["seq"] > number]
        if r["kind"] == ConversionKind.DEPOSIT and r["tick"] == row["tick"] + 3
    )

    def answer_again(rows: Rows) -> Rows:
        rows["particle_id"][rows["seq"] == other] = row["particle_id"]
        return rows

    report = audit(recording.modify_rows(Stream.CONVERSION, answer_again, number=other))
    found = texts(report, Check.DEPOSIT_REQUESTS)
    assert f"particle {row['particle_id']} is answered more often than it landed" in found
    assert "landed and was not answered" in found


@pytest.mark.parametrize(
    "kind", [ConversionKind.EXCAVATE, ConversionKind.DEPOSIT, ConversionKind.OUTSIDE]
)
def test_one_mm3_in_one_conversion_row_is_found(recording, audit, kind) -> None:
    number = numbers_of(recording, Stream.CONVERSION, kind)[5]

    def change(rows: Rows) -> Rows:
        rows["volume_mm3"][rows["seq"] == number] += 1
        return rows

    report = audit(recording.modify_rows(Stream.CONVERSION, change, number=number))
    tick = tick_of(recording, number)
    assert Check.LEDGER in failed(report)
    assert f"in tick {tick + 2}" in texts(report, Check.ACCOUNTS)  # when it is acknowledged
    if kind is not ConversionKind.OUTSIDE:
        assert f"in tick {tick}," in texts(report, Check.TERRAIN)
    if kind is not ConversionKind.EXCAVATE:
        assert f"in tick {tick}" in texts(report, Check.DEPOSIT_REQUESTS)


def test_rows_of_another_layout_are_unread_and_said_to_be_of_another_version(
    recording, audit
) -> None:
    names = [name for name in chunk_dtype(Stream.CONVERSION).names or () if name != "moisture"]
    spoilt = recording.copy()
    for k, (topic, time, message) in enumerate(spoilt.messages):
        if topic == "/soil/conversions":
            rows = repack_fields(from_point_cloud(message, chunk_dtype(Stream.CONVERSION))[names])
            spoilt.messages[k] = (topic, time, to_point_cloud(rows, "map", message.header.stamp))
    report = audit(spoilt)
    text = "\n".join(finding.text for finding in report.findings)
    assert "on /soil/conversions cannot be read" in text
    assert "the cloud lacks moisture" in text
    assert "If another version recorded the bag, audit it with that one" in text
    assert not report.passed


@pytest.mark.parametrize("field", ["soil", "moisture"])
def test_an_answer_as_another_soil_than_landed_is_found(recording, audit, field) -> None:
    number = numbers_of(recording, Stream.CONVERSION, ConversionKind.DEPOSIT)[5]

    def change(rows: Rows) -> Rows:
        rows[field][rows["seq"] == number] += 7
        return rows

    report = audit(recording.modify_rows(Stream.CONVERSION, change, number=number))
    assert failed(report) == {Check.DEPOSIT_REQUESTS}
    said = {"soil": "soil 7 with 0 %", "moisture": "soil 0 with 7 %"}[field]
    text = texts(report, Check.DEPOSIT_REQUESTS)
    assert "landed as soil 0 with 0 % of moisture and was answered as" in text
    assert f"{said} of moisture in tick {tick_of(recording, number)}" in text


def test_one_mm3_in_one_changed_cell_is_found_with_its_cell(recording, audit) -> None:
    rows = recording.rows(Stream.MAP_UPDATE)
    # The last change of some cell before a terrain map.
    last = rows[rows["revision"] <= 20][-1]
    report = audit(
        recording.modify_rows(
            Stream.MAP_UPDATE, alter("volume_mm3", 1, -1), number=int(last["seq"])
        )
    )
    assert failed(report) == {Check.TERRAIN, Check.KEYFRAMES}
    where = f"row {last['row']}, col {last['col']}"
    assert where in texts(report, Check.KEYFRAMES)
    assert "in tick 20" in texts(report, Check.TERRAIN)


def test_one_mm3_in_one_cell_of_a_terrain_map_is_found(recording, audit) -> None:
    spoilt = recording.copy()
    index = [k for k, each in enumerate(spoilt.messages) if each[0] == "/terrain/map"][2]
    topic, time, message = spoilt.messages[index]
    cells = from_point_cloud(message, TERRAIN_CELL).copy()
    cells["volume_mm3"][5 * message.width + 7] -= 1
    changed = type(message)(
        header=message.header,
        height=message.height,
        width=message.width,
        fields=message.fields,
        point_step=message.point_step,
        row_step=message.row_step,
        is_dense=True,
        data=to_byte_array(cells),
    )
    spoilt.messages[index] = (topic, time, changed)
    report = audit(spoilt)
    assert Check.KEYFRAMES in failed(report)
    assert "tick 40" in texts(report, Check.KEYFRAMES)
    assert "row 5, col 7" in texts(report, Check.KEYFRAMES)


def test_a_dropped_machine_header_is_a_gap_with_its_tick(recording, audit) -> None:
    spoilt = recording.copy()
    del spoilt.messages[spoilt.find(machine_topic(1, "soil_tick"), of_tick(30))]
    report = audit(spoilt)
    assert failed(report) == {Check.COMPLETENESS}
    assert texts(report, Check.COMPLETENESS) == "machine 1's header of tick 30 is missing"
    assert report.runs[0].max_imbalance_mm3 == 0  # all else is there


def test_a_dropped_join_is_a_gap(recording, audit) -> None:
    spoilt = recording.copy()
    topic = machine_topic(1, "soil_tick")
    del spoilt.messages[spoilt.find(topic, lambda header: header.verb is Verb.JOIN)]
    assert "machine 1's join before tick 1 is missing" in texts(audit(spoilt), Check.COMPLETENESS)


def test_a_dropped_soil_header_is_a_gap_with_its_tick(recording, audit) -> None:
    spoilt = recording.copy()
    del spoilt.messages[spoilt.find("/soil/tick", of_tick(30))]
    report = audit(spoilt)
    assert "the soil's header of tick 30 is missing" in texts(report, Check.COMPLETENESS)
    assert report.runs[0].max_imbalance_mm3 == 0
    assert Check.DEPOSIT_REQUESTS not in failed(report)


@pytest.mark.parametrize(
    "account",
    ["terrain", "in_flight", "pending", "particles", "absent", "outside", "start"],
)
def test_a_ledger_altered_in_any_account_is_found(recording, audit, account) -> None:
    index = recording.find("/soil/ledger", of_tick(25))
    ledger = from_multi_array(recording.messages[index][2])
    spoilt = change_header(recording, index, **{account: getattr(ledger, account) + 1})
    report = audit(spoilt)
    assert failed(report) == {Check.LEDGER}
    expected = f"the ledger's {account} differs by +1 mm3 in tick 25"
    assert texts(report, Check.LEDGER) == expected


def test_a_dropped_ledger_is_a_gap(recording, audit) -> None:
    spoilt = recording.copy()
    del spoilt.messages[spoilt.find("/soil/ledger", of_tick(25))]
    assert texts(audit(spoilt), Check.COMPLETENESS) == "the ledger of tick 25 is missing"


def test_a_machine_that_loses_one_mm3_is_named(recording, audit) -> None:
    index = recording.find(machine_topic(1, "soil_tick"), of_tick(33))
    header = from_multi_array(recording.messages[index][2])
    assert isinstance(header, MachineHeader)
    report = audit(change_header(recording, index, particles_mm3=header.particles_mm3 - 1))
    assert "machine 1 in tick 33 holds 1 mm3 too little" in texts(report, Check.ACCOUNTS)
    assert report.runs[0].max_imbalance_mm3 == -1
    assert report.runs[0].max_imbalance_tick == 33


def test_a_dropped_landed_row_is_found(recording, audit) -> None:
    row = recording.rows(Stream.DEPOSIT_REQUEST)[20]
    number = int(row["seq"])
    spoilt = recording.modify_rows(
        Stream.DEPOSIT_REQUEST, lambda rows: rows[rows["seq"] != number], number=number
    )
    report = audit(spoilt)
    missing = texts(report, Check.COMPLETENESS)
    assert f"machine 1's LANDED row {number} is missing" in missing
    assert "is answered more often than it landed" in texts(report, Check.DEPOSIT_REQUESTS)


def test_a_header_that_counts_other_rows_than_there_are_is_found(recording, audit) -> None:
    index = recording.find("/soil/tick", of_tick(40))
    header = from_multi_array(recording.messages[index][2])
    assert isinstance(header, SoilHeader)
    fewer = dataclasses.replace(header.conversions, count=header.conversions.count - 1)
    report = audit(change_header(recording, index, conversions=fewer))
    assert "the header of tick 41 counts CONVERSION rows from" in texts(report, Check.COMPLETENESS)


@pytest.mark.parametrize(
    ("stream", "field"), [(Stream.CONVERSION, "tick"), (Stream.MAP_UPDATE, "revision")]
)
def test_a_row_that_says_another_tick_than_its_header_is_found(
    recording, audit, stream, field
) -> None:
    number = int(recording.rows(stream)["seq"][200])
    report = audit(recording.modify_rows(stream, alter(field, 1), number=number))
    assert f"1 {stream.name} row(s) say another {field}" in texts(report, Check.COMPLETENESS)


def test_two_different_headers_of_one_tick_are_found(recording, audit) -> None:
    index = recording.find(machine_topic(1, "soil_tick"), of_tick(10))
    spoilt = recording.copy()
    other = change_header(recording, index, pending_mm3=7).messages[index]
    spoilt.messages.insert(index + 1, other)
    found = texts(audit(spoilt), Check.COMPLETENESS)
    assert "sent two different headers of tick 10" in found


def test_a_message_that_is_not_what_it_should_be_is_found(recording, audit) -> None:
    spoilt = recording.copy()
    index = spoilt.find("/soil/tick", of_tick(12))
    topic, time, message = spoilt.messages[index]
    broken = type(message)(layout=message.layout, data=message.data[:-1])
    spoilt.messages[index] = (topic, time, broken)
    report = audit(spoilt)
    assert any("1 message(s) on /soil/tick cannot be read" in f.text for f in report.findings)
    assert not report.passed


def test_a_bag_that_breaks_off_is_audited_up_to_there_and_not_called_sound(
    recording, tmp_path
) -> None:
    path = recording.write(tmp_path / "a.mcap", chunk_size=20_000)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    report = audit_bag(path)
    assert report.truncated == ("a.mcap",)
    assert any("breaks off" in finding.text for finding in report.findings)
    assert not report.passed
    assert report.balanced
    run_id = report.runs[0]
    assert run_id.max_imbalance_mm3 == 0
    assert 5 < run_id.audited[1] < TICKS


def test_ends_of_topics_that_differ_by_some_ticks_are_left_out_and_said(recording, audit) -> None:
    stop = recording.find("/soil/tick", of_tick(TICKS - 3))
    early = [
        each
        for index, each in enumerate(recording.messages)
        if index < stop or each[0] != "/soil/conversions"
    ]
    report = audit(Recording(early))
    (run_id,) = report.runs
    assert run_id.audited == (0, TICKS - 3)  # its rows come before the header
    assert "were not audited" in run_id.notes[0]
    assert report.balanced
