"""`earthmoving audit BAG`: exit codes and output; and its sum computed independently."""

import json
from pathlib import Path

import numpy as np
import pytest
from mcap_ros2.reader import read_ros2_messages
from support.recorded_exchange import scripted_run
from support.recorded_messages import Recording, machine_topic

from earthmoving_sim import cli
from msg_bridge.audit.report import Check


@pytest.fixture(scope="module")
def recording() -> Recording:
    run = scripted_run(map_interval_ticks=15)
    for _ in range(30):
        run.step()
    run.keyframe()
    return run.recording


def test_sound_bag_exits_with_0_and_prints_its_ticks(recording, tmp_path, capsys) -> None:
    path = recording.write(tmp_path / "a.mcap")
    assert cli.main(["audit", str(path)]) == 0
    out = capsys.readouterr().out
    assert "imbalance +0 mm3" in out
    assert "ticks     31, from 0 to 30" in out
    assert "✗" not in out
    assert "?" not in out
    assert out.splitlines()[-1].startswith("Passed")


def test_bag_without_a_header_exits_with_1_and_prints_its_tick(recording, tmp_path, capsys) -> None:
    modified = recording.copy()
    topic = machine_topic(1, "soil_tick")
    del modified.messages[modified.find(topic, lambda header: header.tick == 12)]
    path = modified.write(tmp_path / "a.mcap")
    assert cli.main(["audit", str(path)]) == 1
    out = capsys.readouterr().out
    assert "→ completeness: machine 1's header of tick 12 is missing" in out
    assert "Passed" not in out


def test_bag_without_terrain_maps_exits_with_1_and_prints_no_imbalance(
    recording, tmp_path, capsys
) -> None:
    path = recording.without("/terrain/map").write(tmp_path / "a.mcap")
    assert cli.main(["audit", str(path)]) == 1
    out = capsys.readouterr().out
    assert "imbalance not computed" in out
    assert "? terrain" in out
    assert "adds up" not in out


def test_missing_bag_exits_with_2(tmp_path: Path, capsys) -> None:
    assert cli.main(["audit", str(tmp_path / "nowhere")]) == 2
    assert str(tmp_path / "nowhere") in capsys.readouterr().err


def test_json_has_the_whole_report(recording, tmp_path, capsys) -> None:
    path = recording.write(tmp_path / "a.mcap")
    assert cli.main(["audit", str(path), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["passed"] is True
    (run,) = report["runs"]
    assert run["max_imbalance_mm3"] == 0
    assert run["audited"] == [0, 30]
    assert {check["check"] for check in run["checks"]} == {check.value for check in Check}


def test_first_terrain_map_plus_conversions_equals_the_last_map(recording, tmp_path) -> None:
    """Decode with mcap-ros2-support and sum with NumPy, without any code of this project."""
    path = recording.write(tmp_path / "a.mcap")
    totals, moved = [], 0
    for message in read_ros2_messages(str(path), topics=["/terrain/map", "/soil/conversions"]):
        cloud = message.ros_msg
        types = {2: "u1", 4: "<u2", 6: "<u4", 7: "<f4", 8: "<f8"}
        dtype = np.dtype(
            {
                "names": [field.name for field in cloud.fields],
                "formats": [types[field.datatype] for field in cloud.fields],
                "offsets": [field.offset for field in cloud.fields],
                "itemsize": cloud.point_step,
            }
        )
        rows = np.frombuffer(bytes(cloud.data), dtype)
        volume = rows["volume_mm3"].astype(np.int64)
        if message.channel.topic == "/terrain/map":
            totals.append(int(volume.sum()))
        else:
            moved += int(volume[rows["kind"] == 1].sum()) - int(volume[rows["kind"] == 0].sum())
    assert len(totals) == 3
    assert moved != 0
    assert totals[-1] == totals[0] + moved
