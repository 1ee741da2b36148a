"""The page of a bag has its figures, and reasons for what is missing."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import WrenchStamped
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from std_msgs.msg import Float64MultiArray, Int64MultiArray, String
from support.recorded_messages import Recording

from earthmoving_sim.cli import main
from earthmoving_sim.run_figures.figures import read_figures
from earthmoving_sim.run_report import write_report
from earthmoving_sim.run_report.reading import read_runs
from earthmoving_sim.run_report.report import signed_volume
from earthmoving_sim.run_report.summary import MachineSummary
from msg_bridge.audit.bag_audit import audit_bag
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.machine_state import PayloadState, to_payload_array
from msg_bridge.codec.row_chunks import to_chunk_cloud
from msg_bridge.codec.terrain import TerrainMap, to_terrain_cloud
from msg_bridge.codec.tick_headers import to_multi_array
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import Keyframe, RowChunk, Stream
from msg_bridge.contract.rows import CONVERSION, empty_rows

BAGS = Path(__file__).parents[3] / "bags"


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, dict[str, Any], Path]:
    """Page, figures and folder of the report on a recorded dig."""
    folder = tmp_path_factory.mktemp("report")
    written = write_report(BagReader(BAGS / "format_2"), folder)
    return written.page.read_text(encoding="utf-8"), written.summary.to_dict(), folder


def test_volumes_are_those_of_the_audit(report: tuple[str, dict[str, Any], Path]) -> None:
    page, figures, _ = report
    (run,) = audit_bag(BAGS / "format_2").runs
    assert figures["max_imbalance"] == run.max_imbalance_mm3 == 0
    assert figures["excavated"] == {1: pytest.approx(run.moved_mm3["EXCAVATE"] * 1e-9)}
    assert figures["deposited"] == {1: pytest.approx(run.moved_mm3["DEPOSIT"] * 1e-9)}
    lost = (run.moved_mm3["OUTSIDE"]) * 1e-9
    assert figures["cut"] - figures["fill"] == pytest.approx(lost, abs=0.05)
    assert f"{figures['cut']:.3f}" in page
    assert "6.52 m³" in page
    assert figures["run_id"] == run.run_id


def test_page_has_its_pictures_inside_and_no_link_to_elsewhere(
    report: tuple[str, dict[str, Any], Path],
) -> None:
    page, _, folder = report
    pictures = list(folder.glob("*.png"))
    assert page.count('src="data:image/png;base64,') == len(pictures) >= 5
    assert {"cut_fill.png", "accounts.png", "production.png"} <= {each.name for each in pictures}
    assert re.findall(r'(?:src|href)="(?!data:|#)', page) == []
    assert "<script" not in page
    assert "Its payload is not recorded" in page
    assert "moved volume" in page  # of the operator


def test_bag_of_another_machine_has_what_its_topics_allow(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    joint_state = store.types["sensor_msgs/msg/JointState"]
    header, time = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    with Writer(tmp_path / "other", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection(
            "/zx135/joint_states", joint_state.__msgtype__, typestore=store
        )
        for number in range(200):
            values = np.array([0.01 * number, 1.0])
            message = joint_state(
                header(time(0, 0), ""), ["boom", "arm"], values, values, np.zeros(0)
            )
            data = store.serialize_cdr(message, joint_state.__msgtype__)
            writer.write(connection, 10**18 + number * 10**7, data)
    written = write_report(BagReader(tmp_path / "other"), tmp_path / "report")
    page = written.page.read_text(encoding="utf-8")
    assert list(written.summary.machines) == ["/zx135"]
    assert (tmp_path / "report/zx135_joints.png").stat().st_size > 10_000
    for reason in ("no terrain map", "no ledger", "payload is not recorded", "no /diagnostics"):
        assert reason in page


def test_malformed_messages_are_counted_and_the_rest_is_used(tmp_path: Path) -> None:
    recording = Recording()
    for number in range(600):
        time = 0.1 * number
        volume = max(0.0, min(1.0, (time % 20 - 5) / 4, (16 - time % 20)))
        recording.add("/m/payload", to_payload_array(PayloadState(volume, 0.0, 0.0, volume, time)))
        if number % 100 == 0:
            recording.add("/m/payload", Float64MultiArray(data=[np.nan]))
            recording.add("/sim/config", String(data="run: {run_id: x}"))
            recording.add("/m/operator/cycles", String(data="[1]"))
            recording.add("/soil/ledger", Int64MultiArray(data=[1, 2]))
    recording.add("/soil/tick", Int64MultiArray())  # so that times are simulation times
    path = recording.write(tmp_path / "bag.mcap")
    written = write_report(BagReader(path), tmp_path / "report")
    assert written.malformed == dict.fromkeys(
        ("/m/payload", "/sim/config", "/m/operator/cycles", "/soil/ledger"), 6
    )
    summary = written.summary.machines["/m"].summary
    assert summary is not None
    assert summary.count == 3
    assert summary.median_duration == pytest.approx(20.0, abs=0.2)
    assert "6 on /m/payload" in written.page.read_text(encoding="utf-8")


def reported_cycles(tmp_path: Path, *reports: dict[str, Any]) -> MachineSummary:
    """Return the summary of two cycles of 20 s and 1 m^3 by payload, reported as given."""
    recording = Recording()
    recording.add("/soil/tick", Int64MultiArray())
    for number in range(420):
        time = 0.1 * number
        volume = max(0.0, min(1.0, (time % 20 - 5) / 4, (16 - time % 20)))
        recording.add("/m/payload", to_payload_array(PayloadState(volume, 0.0, 0.0, volume, time)))
    for report in reports:
        recording.add("/m/operator/cycles", String(data=json.dumps(report)))
    path = recording.write(tmp_path / "bag.mcap")
    return write_report(BagReader(path), tmp_path / "report").summary.machines["/m"]


def test_total_of_the_cycles_is_that_of_the_operator(tmp_path: Path) -> None:
    reports = [{"moved_volume": volume, "duration": 18.0} for volume in (0.9, 1.8)]
    machine = reported_cycles(tmp_path, *reports)
    assert machine.total is not None
    assert machine.total.volume == pytest.approx(2.7)
    assert machine.total.productivity == pytest.approx(2.7 / 36.0 * 3600.0)
    page = (tmp_path / "report" / "index.html").read_text(encoding="utf-8")
    assert "2.70 m³" in page
    assert "270 m³/h" in page


@pytest.mark.parametrize(
    ("num_operators", "num_missing"),
    [
        pytest.param(1, 0, id="whole run"),
        pytest.param(2, 0, id="operator is restarted and counts from 1 again"),
        pytest.param(2, 3, id="bag begins within the first cycle"),
    ],
)
def test_times_of_the_phases_are_those_of_completed_cycles(
    tmp_path: Path, num_operators: int, num_missing: int
) -> None:
    recording = Recording()
    recording.add("/m/payload", to_payload_array(PayloadState(0.0, 0.0, 0.0, 0.0, 0.0)))
    phases = [(0.0, 1, "reach"), (3.0, 1, "dig"), (8.0, 1, "lift"), (10.0, 1, "swing")]
    phases += [(14.0, 1, "dump"), (16.0, 2, "reach"), (20.0, 2, "dig"), (31.0, 2, "settle")]
    phases += [(34.0, 2, "done")]
    for operator in range(num_operators):
        for time, cycle, phase in phases[0 if operator else num_missing :]:
            text = json.dumps({"time": 40.0 * operator + time, "cycle": cycle, "phase": phase})
            recording.add("/m/operator/phase", String(data=text))
        recording.add("/m/operator/cycles", String(data=json.dumps({"number": 1})))
    path = recording.write(tmp_path / "bag.mcap")
    machine = write_report(BagReader(path), tmp_path / "report").summary.machines["/m"]
    assert machine.phase_times == {"return": 3, "dig": 5, "lift": 2, "swing": 4, "dump": 2}


@pytest.mark.parametrize("report", [{"number": 1}, {"moved_volume": np.nan, "duration": 1.0}, None])
def test_total_of_the_cycles_is_by_payload_without_complete_reports(
    tmp_path: Path, report: dict[str, Any] | None
) -> None:
    machine = reported_cycles(tmp_path, *([report] if report else []))
    assert machine.total is not None
    assert machine.total == machine.summary
    assert machine.total.volume == pytest.approx(2.0, rel=0.05)


@pytest.mark.parametrize(
    ("change", "text"),
    [(-6.5e-5, "-0.000065"), (-0.25, "-0.250"), (1.5, "+1.500"), (0.0, "+0.000")],
)
def test_small_difference_of_fill_and_cut_can_be_read(change: float, text: str) -> None:
    assert signed_volume(change) == text


@pytest.mark.parametrize(
    "parts",
    [([1, 2], [2, 3], [1, 2, 3]), ([1], [3], [2], [2, 3])],
    ids=["again", "after later ones"],
)
def test_conversions_that_were_sent_again_count_once(
    tmp_path: Path, parts: tuple[list[int], ...]
) -> None:
    recording = Recording()
    for numbers in parts:
        rows = empty_rows(CONVERSION, len(numbers))
        rows["seq"], rows["volume_mm3"], rows["machine_id"] = numbers, 10**9, 1
        chunk = RowChunk(7, Stream.CONVERSION, 0, 0, rows)
        recording.add("/soil/conversions", to_chunk_cloud(chunk, "map", Time(sec=1)))
    reader = BagReader(recording.write(tmp_path / "bag.mcap"))
    assert write_report(reader, tmp_path / "report").summary.excavated == {1: pytest.approx(3.0)}
    assert read_figures(reader, 7, 0.0, 1.0).excavated == pytest.approx(3.0)


def test_page_of_a_bag_that_begins_within_a_run_states_what_is_not_known(tmp_path: Path) -> None:
    """Its first configuration is that of the next run."""
    recording = Recording()
    grid = Grid(2, 2, 1.0)
    zeros, layer = np.zeros(grid.shape), np.zeros(grid.shape, np.uint8)
    keyframe = Keyframe(7, 30, grid, zeros, zeros.astype(np.int64), layer, layer)
    for number in range(40):
        tick = 500 + number
        rows = empty_rows(CONVERSION, 1)
        rows["seq"], rows["volume_mm3"], rows["machine_id"] = 201 + 2 * number, 10**9, 1
        stamp = Time(sec=tick)
        if number < 30:
            chunk = RowChunk(7, Stream.CONVERSION, 0, 0, rows)
            recording.add("/soil/conversions", to_chunk_cloud(chunk, "map", stamp))
        ledger = Ledger(7, tick, 0, 0, 0, 0, 0, 0, 0, stamp_sec=tick)
        recording.add("/soil/ledger", to_multi_array(ledger))
        if number == 5:
            cloud = to_terrain_cloud(TerrainMap(keyframe, zeros), "map", stamp)
            recording.add("/terrain/map", cloud)
    recording.add("/soil/tick", Int64MultiArray())
    for run_id in (8, 9):
        recording.add("/sim/config", String(data=f"run: {{run_id: {run_id}}}"))
        recording.add("/soil/ledger", to_multi_array(Ledger(run_id, 0, 0, 0, 0, 0, 0, 0, 0)))
    reader = BagReader(recording.write(tmp_path / "bag.mcap"))
    written = write_report(reader, tmp_path / "report", run_id=7)
    figures = written.summary
    assert written.run_ids == [7, 8, 9]
    assert figures.simulated_time == 39.0
    assert (figures.first_tick, figures.start_revision) == (500, 30)
    assert (figures.earlier_conversions, figures.missing_conversions) == (200, 29)
    page = written.page.read_text(encoding="utf-8")
    for text in ("at tick 500", "first 200 conversion rows", "lacks 29 conv", "of 505.00 s"):
        assert text in page


def test_stamps_of_another_clock_are_not_simulation_times(tmp_path: Path) -> None:
    recording = Recording()
    recording.add("/soil/tick", Int64MultiArray())
    for number in range(60):
        ledger = Ledger(7, 100 * number, 0, 0, 0, 0, 0, 0, 0, stamp_sec=number)
        recording.add("/soil/ledger", to_multi_array(ledger))
        for topic, sec in (("/m/bucket/wrench", number), ("/sensor/wrench", 1_795_861_013)):
            wrench = WrenchStamped()
            wrench.header.stamp, wrench.wrench.force.x = Time(sec=sec), 5.0
            recording.add(topic, wrench)
    reader = BagReader(recording.write(tmp_path / "bag.mcap"))
    assert write_report(reader, tmp_path / "report").summary.simulated_time == 59.0
    run, _ = read_runs(reader)
    for machine, tool in (("/m", "bucket"), ("", "sensor")):
        assert run.machines[machine].forces[tool].times == pytest.approx(np.arange(60.0))


def test_reports_of_a_problem_with_other_numbers_are_one_row(tmp_path: Path) -> None:
    recording = Recording()
    for level, node, text in (
        (1, "soil_sim", "real-time factor 0.27, below 1 for 9 s: ticks wait for machine 1"),
        (2, "soil_sim", "real-time factor 0.18, below 1 for 10 s: ticks wait for machine 1"),
        (1, "soil_sim", "real-time factor 0.66, below 1 for 11 s: ticks wait for machine 1"),
        (1, "soil_sim", "real-time factor 0.55, below 1 for 12 s: ticks wait for machine 2"),
        (1, "digger1/machine_sim", "a tick takes 1.37 of its period"),
        (1, "digger2/machine_sim", "a tick takes 1.5 of its period"),
        (1, "recorder", "the state of /digger1"),
        (1, "recorder", "the state of /digger2"),
    ):
        status = DiagnosticStatus(level=bytes([level]), name=node, message=text)
        recording.add("/diagnostics", DiagnosticArray(status=[status]))
    recording.messages = [  # one a second
        (topic, 10**9 + 10**6 * time, each) for topic, time, each in recording.messages
    ]
    written = write_report(BagReader(recording.write(tmp_path / "bag.mcap")), tmp_path / "report")
    page = written.page.read_text(encoding="utf-8")
    rows = [
        re.findall(r"<td[^>]*>([^<]*)</td>", row)
        for row in re.findall(r"<tr>(.*?)</tr>", page.partition("Reported by nodes")[2])
    ]
    rows = [row for row in rows if len(row) == 6]
    assert rows[0] == [
        "soil_sim",
        "error",
        "real-time factor 0.18, below 1 for 10 s: ticks wait for machine 1",
        "3",
        "0.0",
        "2.0",
    ]
    assert len(rows) == 6, "other machines and nodes have other problems"


def test_one_run_of_several_is_chosen(tmp_path: Path) -> None:
    recording = Recording()
    for run_id in (4, 5):
        recording.add("/sim/config", String(data=f"run: {{run_id: {run_id}}}"))
        for number in range(3):
            volume = {4: 0.9, 5: 0.5}[run_id]
            message = to_payload_array(PayloadState(volume, 0.0, 0.0, 0.1, float(number)))
            recording.add("/m/payload", message)
    path = recording.write(tmp_path / "bag.mcap")
    for chosen, volume in ((None, 0.5), (4, 0.9)):
        written = write_report(BagReader(path), tmp_path / f"report_{chosen}", run_id=chosen)
        assert written.run_ids == [4, 5]
        assert written.summary.machines["/m"].max_payload == pytest.approx(volume)
    assert main(["report", str(path), "--run", "6", "-o", str(tmp_path / "none")]) == 2


def test_command_prints_the_figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    recording = Recording()
    recording.add("/m/payload", to_payload_array(PayloadState(1.0, 0.0, 0.0, 0.5, 2.0)))
    path = recording.write(tmp_path / "bag.mcap")
    folder = tmp_path / "out"
    assert main(["report", str(path), "-o", str(folder), "--title", "<Site> A", "--json"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["page"] == str(folder / "index.html")
    assert figures["machines"]["/m"]["max_payload"] == 1.0
    assert "<h1>&lt;Site&gt; A</h1>" in (folder / "index.html").read_text(encoding="utf-8")


def test_former_report_is_replaced_and_no_other_folder_is_written_to(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = Recording()
    recording.add("/m/payload", to_payload_array(PayloadState(1.0, 0.0, 0.0, 0.5, 2.0)))
    path = recording.write(tmp_path / "bag.mcap")
    former, other = tmp_path / "former", tmp_path / "site"
    for title in ("first", "second"):
        assert main(["report", str(path), "-o", str(former), "--title", title]) == 0
    page = (former / "index.html").read_text(encoding="utf-8")
    assert "<h1>second</h1>" in page
    other.mkdir()
    (other / "index.html").write_text("<h1>My site</h1>")
    for output in (other, path):
        assert main(["report", str(path), "-o", str(output)]) == 2
        assert str(output) in capsys.readouterr().err
    assert [each.name for each in other.iterdir()] == ["index.html"]
    assert (other / "index.html").read_text() == "<h1>My site</h1>"
