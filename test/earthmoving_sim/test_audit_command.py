"""`earthmoving audit BAG`: its exit codes and what it prints; and the same sum by other means."""

import json
from pathlib import Path

import numpy as np
import pytest
from mcap_ros2.reader import read_ros2_messages
from support.recorded_exchange import scripted_run
from support.recorded_messages import Recording, machine_topic

from earthmoving_sim import cli


@pytest.fixture(scope="module")
def recording() -> Recording:
    run = scripted_run(map_interval_ticks=15)
    for _ in range(30):
        run.step()
    run.keyframe()
    return run.recording


def test_a_sound_bag_exits_with_0_and_says_how_much_was_moved(recording, tmp_path, capsys) -> None:
    path = recording.write(tmp_path / "a.mcap")
    assert cli.main(["audit", str(path)]) == 0
    out = capsys.readouterr().out
    assert "imbalance +0 mm3 at worst, in any tick" in out
    assert "ticks     31, from 0 to 30" in out
    assert "✗" not in out
    assert "?" not in out
    assert out.rstrip().endswith("not 1 mm3 is missing or too much.")


def test_a_spoilt_bag_exits_with_1_and_names_the_place(recording, tmp_path, capsys) -> None:
    spoilt = recording.copy()
    topic = machine_topic(1, "soil_tick")
    del spoilt.messages[spoilt.find(topic, lambda header: header.tick == 12)]
    path = spoilt.write(tmp_path / "a.mcap")
    assert cli.main(["audit", str(path)]) == 1
    out = capsys.readouterr().out
    assert "→ completeness: machine 1's header of tick 12 is missing" in out
    assert "Sound" not in out


def test_a_bag_that_cannot_show_it_exits_with_1_and_claims_nothing(
    recording, tmp_path, capsys
) -> None:
    path = recording.without("/terrain/map").write(tmp_path / "a.mcap")
    assert cli.main(["audit", str(path)]) == 1
    out = capsys.readouterr().out
    assert "imbalance not computed" in out
    assert "? terrain" in out
    assert "adds up" not in out


def test_what_is_no_bag_exits_with_2_and_says_why(tmp_path: Path, capsys) -> None:
    assert cli.main(["audit", str(tmp_path / "nowhere")]) == 2
    assert "there is no bag" in capsys.readouterr().err


def test_json_tells_the_whole_report(recording, tmp_path, capsys) -> None:
    path = recording.write(tmp_path / "a.mcap")
    assert cli.main(["audit", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["passed"] is True
    (epoch,) = told["runs"]
    assert epoch["max_imbalance_mm3"] == 0
    assert epoch["audited"] == [0, 30]
    assert {check["check"] for check in epoch["checks"]} >= {"ledger", "keyframes", "landings"}


def test_first_terrain_map_and_conversions_make_the_last_one_by_other_means(
    recording, tmp_path
) -> None:
    """Read by a stranger's decoder and added up in NumPy, with nothing of this package."""
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
