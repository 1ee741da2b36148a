"""Random access returns what reading from the start returns."""

from __future__ import annotations

from pathlib import Path

import pytest
from std_msgs.msg import String
from support.recorded_messages import Recording

from msg_bridge.bag.reader import BagReader

BAGS = Path(__file__).parents[3] / "bags"
TOPICS = ["/terrain/map", "/terrain/map_updates", "/soil/ledger", "/excavator/joint_states"]


def recording() -> Recording:
    made = Recording()
    for number in range(3000):
        made.add(f"/topic_{number % 3}", String(data=f"{number} " * 50))
    return made


@pytest.mark.parametrize("name", ["format_1", "format_2"])
def test_messages_and_their_order_are_those_of_the_reader(name: str) -> None:
    reader = BagReader(BAGS / name)
    index = reader.index([*TOPICS, "/missing"])
    expected = list(reader.raw_messages(TOPICS))
    found = [
        (index.topics[index.topic_numbers[n]], int(index.times[n]), index.read(n))
        for n in range(index.size)
    ]
    assert found == expected
    index.close()


def test_bag_of_a_killed_recorder_is_scanned(tmp_path: Path) -> None:
    folder = recording().write_folder(tmp_path / "bag", finish=False)
    reader = BagReader(folder)
    index = reader.index(reader.topics)
    assert index.size == sum(each.count for each in reader.topics.values()) > 1000
    assert [index.read(n) for n in range(index.size)] == [m[2] for m in reader.raw_messages()]
    index.close()


def test_latest_message_before_a_number_is_found(tmp_path: Path) -> None:
    reader = BagReader(recording().write(tmp_path / "bag.mcap"))
    index = reader.index(reader.topics)
    assert index.latest("/topic_1", 1) is None
    assert index.latest("/topic_1", 2) == 1
    assert index.latest("/topic_1", 1000) == 997
    assert index.latest("/missing", 1000) is None
    index.close()
