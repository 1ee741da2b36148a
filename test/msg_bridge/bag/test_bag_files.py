"""Names of bags, by which commands name what they write."""

from pathlib import Path

import pytest

from earthmoving_sim.cli import main
from msg_bridge.bag.bag_files import bag_name
from msg_bridge.bag.writer import BagWriter


@pytest.mark.parametrize(
    ("path", "name"),
    [
        ("bags/mine", "mine"),
        ("bags/2026.11.28", "2026.11.28"),
        ("bags/mine_0.mcap", "mine_0"),
        ("bags/mine.v2.mcap", "mine.v2"),
        ("bags/mine/.", "mine"),
    ],
)
def test_name_of_a_bag_is_that_of_its_folder_or_of_its_file_without_mcap(
    path: str, name: str
) -> None:
    assert bag_name(Path(path)) == name


def test_reports_on_bags_that_differ_after_a_dot_do_not_replace_each_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("2026.11.27", "2026.11.28"):
        writer = BagWriter(Path(name))
        writer.add_topic("/texts", "std_msgs/msg/String", [])
        writer.write("/texts", b"\0\1\0\0\1\0\0\0\0", 1, 1, 1)
        writer.close({})
        assert main(["report", name]) == 0
    assert {each.name for each in (tmp_path / "out/report").iterdir()} == {
        "2026.11.27",
        "2026.11.28",
    }
