"""Every manipulation of a sound bag is found and reported with its tick."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from numpy.lib.recfunctions import repack_fields
from support.audit_reports import failed_checks, finding_texts, has_tick
from support.recorded_messages import Recording, machine_topic

from msg_bridge.audit.bag_audit import audit_bag
from msg_bridge.audit.report import Check
from msg_bridge.bag.recording_begin import RECORD_FROM_BEGIN
from msg_bridge.codec.point_cloud import from_point_cloud, to_byte_array, to_point_cloud
from msg_bridge.codec.row_chunks import chunk_dtype
from msg_bridge.codec.terrain import TERRAIN_CELL
from msg_bridge.codec.tick_headers import from_multi_array, to_multi_array
from msg_bridge.contract.messages import MachineHeader, SoilHeader, Stream, Verb
from msg_bridge.contract.rows import ConversionKind, Rows

TICKS = 60  # of the recording


def change_header(recording: Recording, index: int, **values: object) -> Recording:
    modified = recording.copy()
    topic, time, message = modified.messages[index]
    header = dataclasses.replace(from_multi_array(message), **values)
    modified.messages[index] = (topic, time, to_multi_array(header))
    return modified


def add_to(field: str, value: int, index: int = 0) -> Callable[[Rows], Rows]:
    def change(rows: Rows) -> Rows:
        rows[field][index] += value
        return rows

    return change


def conversion_numbers(recording: Recording, kind: ConversionKind) -> list[int]:
    """Return the numbers of the conversion rows of a kind."""
    rows = recording.rows(Stream.CONVERSION)
    return rows["seq"][rows["kind"] == kind].tolist()


def tick_of(recording: Recording, number: int) -> int:
    rows = recording.rows(Stream.CONVERSION)
    return int(rows["tick"][rows["seq"] == number][0])


def test_missing_conversion_row_is_reported_with_its_tick(recording, audit) -> None:
    number = conversion_numbers(recording, ConversionKind.EXCAVATE)[100]
    modified = recording.modify_rows(
        Stream.CONVERSION, lambda rows: rows[rows["seq"] != number], number=number
    )
    report = audit(modified)
    tick = tick_of(recording, number)
    assert f"CONVERSION row {number} is missing (tick {tick})" in finding_texts(
        report, Check.COMPLETENESS
    )
    assert not report.passed


def test_conversion_row_added_twice_is_found(recording, audit) -> None:
    number = conversion_numbers(recording, ConversionKind.DEPOSIT)[10]

    def duplicate(rows: Rows) -> Rows:
        row = rows[rows["seq"] == number]
        row["seq"] += 1
        return np.concatenate([rows, row])

    report = audit(recording.modify_rows(Stream.CONVERSION, duplicate, number=number))
    assert "different contents" in finding_texts(report, Check.COMPLETENESS)
    assert not report.passed


def test_particle_with_two_answers_is_found(recording, audit) -> None:
    number = conversion_numbers(recording, ConversionKind.DEPOSIT)[10]
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
    texts = finding_texts(report, Check.DEPOSIT_REQUESTS)
    assert f"particle {row['particle_id']} has more answers than deposit requests" in texts
    assert "has no answer" in texts


@pytest.mark.parametrize(
    "kind", [ConversionKind.EXCAVATE, ConversionKind.DEPOSIT, ConversionKind.OUTSIDE]
)
def test_error_of_1_mm3_in_a_conversion_row_is_found(recording, audit, kind) -> None:
    number = conversion_numbers(recording, kind)[5]

    def change(rows: Rows) -> Rows:
        rows["volume_mm3"][rows["seq"] == number] += 1
        return rows

    report = audit(recording.modify_rows(Stream.CONVERSION, change, number=number))
    tick = tick_of(recording, number)
    assert Check.LEDGER in failed_checks(report)
    assert f"in tick {tick + 2}" in finding_texts(report, Check.ACCOUNTS)  # when it is acknowledged
    if kind is not ConversionKind.OUTSIDE:
        assert f"in tick {tick}," in finding_texts(report, Check.TERRAIN)
    if kind is not ConversionKind.EXCAVATE:
        assert f"in tick {tick}" in finding_texts(report, Check.DEPOSIT_REQUESTS)


def test_rows_of_another_layout_cannot_be_decoded(recording, audit) -> None:
    names = [name for name in chunk_dtype(Stream.CONVERSION).names or () if name != "moisture"]
    modified = recording.copy()
    for k, (topic, time, message) in enumerate(modified.messages):
        if topic == "/soil/conversions":
            rows = repack_fields(from_point_cloud(message, chunk_dtype(Stream.CONVERSION))[names])
            modified.messages[k] = (topic, time, to_point_cloud(rows, "map", message.header.stamp))
    report = audit(modified)
    text = "\n".join(finding.text for finding in report.findings)
    assert "on /soil/conversions cannot be decoded" in text
    assert "moisture" in text
    assert not report.passed


@pytest.mark.parametrize("field", ["soil", "moisture"])
def test_answer_with_another_material_than_its_request_is_found(recording, audit, field) -> None:
    number = conversion_numbers(recording, ConversionKind.DEPOSIT)[5]

    def change(rows: Rows) -> Rows:
        rows[field][rows["seq"] == number] += 7
        return rows

    report = audit(recording.modify_rows(Stream.CONVERSION, change, number=number))
    assert failed_checks(report) == {Check.DEPOSIT_REQUESTS}
    material = {"soil": "soil 7 with 0 %", "moisture": "soil 0 with 7 %"}[field]
    text = finding_texts(report, Check.DEPOSIT_REQUESTS)
    assert "of soil 0 with 0 % of moisture was answered with" in text
    assert f"{material} of moisture in tick {tick_of(recording, number)}" in text


def test_error_of_1_mm3_in_a_map_update_is_reported_with_its_cell(recording, audit) -> None:
    rows = recording.rows(Stream.MAP_UPDATE)
    # The last update before a terrain map.
    last = rows[rows["revision"] <= 20][-1]
    report = audit(
        recording.modify_rows(
            Stream.MAP_UPDATE, add_to("volume_mm3", 1, -1), number=int(last["seq"])
        )
    )
    assert failed_checks(report) == {Check.TERRAIN, Check.KEYFRAMES}
    cell = f"row {last['row']}, col {last['col']}"
    assert cell in finding_texts(report, Check.KEYFRAMES)
    assert "in tick 20" in finding_texts(report, Check.TERRAIN)


def test_error_of_1_mm3_in_a_terrain_map_is_reported_with_its_cell(recording, audit) -> None:
    modified = recording.copy()
    index = [k for k, each in enumerate(modified.messages) if each[0] == "/terrain/map"][2]
    topic, time, message = modified.messages[index]
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
    modified.messages[index] = (topic, time, changed)
    report = audit(modified)
    assert Check.KEYFRAMES in failed_checks(report)
    assert "tick 40" in finding_texts(report, Check.KEYFRAMES)
    assert "row 5, col 7" in finding_texts(report, Check.KEYFRAMES)


def test_missing_machine_header_is_reported_with_its_tick(recording, audit) -> None:
    modified = recording.copy()
    del modified.messages[modified.find(machine_topic(1, "soil_tick"), has_tick(30))]
    report = audit(modified)
    assert failed_checks(report) == {Check.COMPLETENESS}
    assert finding_texts(report, Check.COMPLETENESS) == "machine 1's header of tick 30 is missing"
    assert report.runs[0].max_imbalance_mm3 == 0  # nothing else is missing


def test_bag_that_began_after_the_join_is_reported_with_the_remedy(recording, audit) -> None:
    modified = recording.copy()
    topic = machine_topic(1, "soil_tick")
    del modified.messages[modified.find(topic, lambda header: header.verb is Verb.JOIN)]
    found = finding_texts(audit(modified), Check.COMPLETENESS)
    assert f"machine 1's join before tick 1 is missing; {RECORD_FROM_BEGIN}" in found


def test_missing_soil_header_is_reported_with_its_tick(recording, audit) -> None:
    modified = recording.copy()
    del modified.messages[modified.find("/soil/tick", has_tick(30))]
    report = audit(modified)
    assert "the soil's header of tick 30 is missing" in finding_texts(report, Check.COMPLETENESS)
    assert report.runs[0].max_imbalance_mm3 == 0
    assert Check.DEPOSIT_REQUESTS not in failed_checks(report)


@pytest.mark.parametrize(
    "account",
    ["terrain", "in_flight", "pending", "particles", "absent", "outside", "start"],
)
def test_modified_ledger_is_found_in_every_account(recording, audit, account) -> None:
    index = recording.find("/soil/ledger", has_tick(25))
    ledger = from_multi_array(recording.messages[index][2])
    modified = change_header(recording, index, **{account: getattr(ledger, account) + 1})
    report = audit(modified)
    assert failed_checks(report) == {Check.LEDGER}
    expected = f"the ledger's {account} differs by +1 mm3 in tick 25"
    assert finding_texts(report, Check.LEDGER) == expected


def test_missing_ledger_is_found(recording, audit) -> None:
    modified = recording.copy()
    del modified.messages[modified.find("/soil/ledger", has_tick(25))]
    assert finding_texts(audit(modified), Check.COMPLETENESS) == "the ledger of tick 25 is missing"


def test_machine_that_loses_1_mm3_is_named(recording, audit) -> None:
    index = recording.find(machine_topic(1, "soil_tick"), has_tick(33))
    header = from_multi_array(recording.messages[index][2])
    assert isinstance(header, MachineHeader)
    report = audit(change_header(recording, index, particles_mm3=header.particles_mm3 - 1))
    assert "machine 1 in tick 33 has 1 mm3 too little" in finding_texts(report, Check.ACCOUNTS)
    assert report.runs[0].max_imbalance_mm3 == -1
    assert report.runs[0].max_imbalance_tick == 33


def test_missing_deposit_request_is_found(recording, audit) -> None:
    row = recording.rows(Stream.DEPOSIT_REQUEST)[20]
    number = int(row["seq"])
    modified = recording.modify_rows(
        Stream.DEPOSIT_REQUEST, lambda rows: rows[rows["seq"] != number], number=number
    )
    report = audit(modified)
    missing = finding_texts(report, Check.COMPLETENESS)
    assert f"machine 1's DEPOSIT_REQUEST row {number} is missing" in missing
    assert not report.passed


def test_header_that_counts_other_rows_is_found(recording, audit) -> None:
    index = recording.find("/soil/tick", has_tick(40))
    header = from_multi_array(recording.messages[index][2])
    assert isinstance(header, SoilHeader)
    fewer = dataclasses.replace(header.conversions, count=header.conversions.count - 1)
    report = audit(change_header(recording, index, conversions=fewer))
    assert "the header of tick 41 counts CONVERSION rows from" in finding_texts(
        report, Check.COMPLETENESS
    )


@pytest.mark.parametrize(
    ("stream", "field"), [(Stream.CONVERSION, "tick"), (Stream.MAP_UPDATE, "revision")]
)
def test_row_with_another_tick_than_its_header_is_found(recording, audit, stream, field) -> None:
    number = int(recording.rows(stream)["seq"][200])
    report = audit(recording.modify_rows(stream, add_to(field, 1), number=number))
    assert f"1 {stream.name} row(s) have another {field}" in finding_texts(
        report, Check.COMPLETENESS
    )


def test_different_headers_of_one_tick_are_found(recording, audit) -> None:
    index = recording.find(machine_topic(1, "soil_tick"), has_tick(10))
    modified = recording.copy()
    other = change_header(recording, index, pending_mm3=7).messages[index]
    modified.messages.insert(index + 1, other)
    texts = finding_texts(audit(modified), Check.COMPLETENESS)
    assert "sent two different headers of tick 10" in texts


def test_invalid_message_is_found(recording, audit) -> None:
    modified = recording.copy()
    index = modified.find("/soil/tick", has_tick(12))
    topic, time, message = modified.messages[index]
    broken = type(message)(layout=message.layout, data=message.data[:-1])
    modified.messages[index] = (topic, time, broken)
    report = audit(modified)
    assert any("1 message(s) on /soil/tick cannot be decoded" in f.text for f in report.findings)
    assert not report.passed


def test_truncated_bag_is_audited_up_to_its_end_and_does_not_pass(recording, tmp_path) -> None:
    path = recording.write(tmp_path / "a.mcap", chunk_size=20_000)
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    report = audit_bag(path)
    assert report.truncated == ("a.mcap",)
    assert [finding.check for finding in report.findings] == [Check.COMPLETENESS]
    assert not report.passed
    assert report.balanced
    run = report.runs[0]
    assert run.max_imbalance_mm3 == 0
    assert 5 < run.audited[1] < TICKS


def test_ticks_at_which_topics_end_differently_are_not_audited(recording, audit) -> None:
    stop = recording.find("/soil/tick", has_tick(TICKS - 3))
    shortened = [
        each
        for index, each in enumerate(recording.messages)
        if index < stop or each[0] != "/soil/conversions"
    ]
    report = audit(Recording(shortened))
    (run,) = report.runs
    assert run.audited == (0, TICKS - 3)  # rows are recorded before their header
    assert len(run.notes) == 1
    assert report.balanced
