"""Files, terrain keyframes and the queue of a recording, without ROS topics."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.rosbag2 import Reader
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from msg_bridge.bag.reader import BagReader
from msg_bridge.bag.writer import BagError, BagWriter
from msg_bridge.codec.stamps import stamp_from_seconds
from msg_bridge.codec.terrain import TerrainMap, to_terrain_cloud
from msg_bridge.codec.terrain_delta import encode_delta
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe
from msg_bridge.raw_topics.received_message import ReceivedMessage
from msg_bridge.recorder.background_writer import BackgroundWriter
from msg_bridge.recorder.params import RecorderParams
from msg_bridge.recorder.recording import BagRecording

MAP, DELTAS, TEXTS, CONFIG = "/terrain/map", "/terrain/map_deltas", "/texts", "/sim/config"
SECOND = 10**9
GRID = Grid(rows=40, cols=40, cell=0.1)
PUBLISHER = frozenset([b"one"])


def recording(
    folder: Path, writer: BackgroundWriter | None = None, **params: float
) -> BagRecording:
    writer = writer or BackgroundWriter(BagWriter(folder), 1 << 28)
    made = BagRecording(writer, RecorderParams(**params))
    made.add_topic(TEXTS, "std_msgs/msg/String", [], None)
    made.add_topic(CONFIG, "std_msgs/msg/String", [], None)
    made.add_topic(MAP, "sensor_msgs/msg/PointCloud2", [], None)
    for topic in (CONFIG, MAP):
        made.update_publishers(topic, PUBLISHER, transient_local=True)
    made.update_publishers(TEXTS, PUBLISHER, transient_local=False)
    return made


def terrain(revision: int) -> bytes:
    """Return a serialised map in which `revision` columns differ from revision 0."""
    volume = np.full(GRID.shape, 10**9)
    volume.ravel()[:revision] += revision
    layer = np.zeros(GRID.shape, np.uint8)
    keyframe = Keyframe(7, revision, GRID, volume / 1e7, volume, layer, layer)
    cloud = TerrainMap(keyframe, np.zeros(GRID.shape))
    return serialize_message(to_terrain_cloud(cloud, "map", stamp_from_seconds(revision)))


def decoded(maps: Iterable[bytes]) -> list[PointCloud2]:
    """Return the messages of CDR bytes, whose padding is undefined."""
    return [deserialize_message(data, PointCloud2) for data in maps]


def read_maps(path: Path) -> list[PointCloud2]:
    return decoded(data for _, _, data in BagReader(path).raw_messages([MAP]))


def text(number: int, size: int = 0) -> bytes:
    return serialize_message(String(data=f"{number} " + "x" * size))


def write(recording: BagRecording, topic: str, data: bytes, number: int, time: float) -> None:
    log_time = round(time * SECOND)
    recording.write(ReceivedMessage(topic, data, log_time, log_time, number), log_time)


def counts(folder: Path) -> dict[str, int]:
    with Reader(folder) as reader:
        return {each.topic: each.msgcount for each in reader.connections if each.msgcount}


def write_maps(folder: Path, **params: float) -> list[PointCloud2]:
    """Record a map every 2 s for 60 s; return the maps."""
    made, maps = recording(folder, **params), [terrain(number) for number in range(31)]
    for number, data in enumerate(maps):
        write(made, MAP, data, number + 1, 2.0 * number)
    made.close()
    return decoded(maps)


def test_maps_between_keyframes_are_recorded_as_deltas_and_read_as_maps(tmp_path: Path) -> None:
    maps = write_maps(tmp_path / "dig", terrain_keyframe_period=20.0)
    assert counts(tmp_path / "dig") == {MAP: 4, DELTAS: 27}
    reader = BagReader(tmp_path / "dig")
    assert reader.topics[MAP].count == 31
    assert DELTAS not in reader.topics
    assert read_maps(tmp_path / "dig") == maps
    index = reader.index([MAP])
    backwards = decoded(index.read(number) for number in reversed(range(index.size)))
    assert backwards == maps[::-1]
    index.close()


def test_bag_that_begins_between_keyframes_has_the_maps_from_the_next_keyframe_on(
    tmp_path: Path,
) -> None:
    maps = write_maps(tmp_path / "dig", max_bagfile_duration=30.0)
    assert read_maps(tmp_path / "dig/dig_1.mcap") == maps[14:30]
    first = tmp_path / "dig/dig_0.mcap"
    cut = BagWriter(tmp_path / "cut")
    with Reader(first) as source:
        for connection, time, data in source.messages():
            if time > 4 * SECOND:  # without the first keyframe
                if connection.topic not in cut.topics:
                    cut.add_topic(connection.topic, connection.msgtype)
                cut.write(connection.topic, data, time, time)
    cut.close()
    assert read_maps(tmp_path / "cut") == maps[10:15]


def test_without_keyframe_period_every_map_is_recorded_in_full(tmp_path: Path) -> None:
    write_maps(tmp_path / "dig", terrain_keyframe_period=0.0)
    assert counts(tmp_path / "dig") == {MAP: 31}


def test_map_that_does_not_change_is_repeated_in_full(tmp_path: Path) -> None:
    made = recording(tmp_path / "dig", terrain_keyframe_period=20.0)
    for number in range(3):
        write(made, MAP, terrain(number), number + 1, float(number))
    for time in range(3, 60):
        made.repeat_transient_local(time * SECOND)
    made.close()
    maps = list(BagReader(tmp_path / "dig").raw_messages([MAP]))
    assert [time / SECOND for _, time, _ in maps] == [0.0, 1.0, 2.0, 20.0, 40.0]
    assert decoded(data for _, _, data in maps[2:]) == decoded(3 * [terrain(2)])
    assert counts(tmp_path / "dig") == {MAP: 3, DELTAS: 2}


def test_first_map_of_a_file_is_recorded_in_full_on_a_volatile_topic(tmp_path: Path) -> None:
    """It is not repeated there."""
    made = recording(tmp_path / "dig", max_bagfile_duration=10.0)
    made.update_publishers(MAP, PUBLISHER, transient_local=False)
    for number in range(20):
        write(made, MAP, terrain(number), number + 1, float(number))
    made.close()
    expected = decoded(terrain(number) for number in range(10, 20))
    assert read_maps(tmp_path / "dig/dig_1.mcap") == expected


def test_deltas_of_a_bag_that_is_played_are_recorded_with_maps_in_full(tmp_path: Path) -> None:
    made = recording(tmp_path / "dig")
    for number in range(2):  # own deltas, until the player of the bag is found
        write(made, MAP, terrain(number), number + 1, float(number))
    played = encode_delta(terrain(3), terrain(4))
    assert played is not None
    made.update_publishers(DELTAS, PUBLISHER, transient_local=False)
    write(made, MAP, terrain(3), 3, 3.0)
    write(made, DELTAS, played, 1, 4.0)
    made.close()
    assert counts(tmp_path / "dig") == {MAP: 2, DELTAS: 2}
    assert read_maps(tmp_path / "dig") == decoded(terrain(number) for number in (0, 1, 3, 4))


@pytest.mark.parametrize("limit", [{"max_bagfile_size": 100_000}, {"max_bagfile_duration": 10.0}])
def test_every_file_of_a_bag_is_readable_on_its_own(
    tmp_path: Path, limit: dict[str, float]
) -> None:
    writer = BackgroundWriter(BagWriter(tmp_path / "dig"), 1 << 28)
    made = recording(tmp_path / "dig", writer, **limit)
    rng = np.random.default_rng(1)
    write(made, CONFIG, text(-1), 1, 0.0)
    write(made, MAP, terrain(1), 1, 0.0)
    texts = [text(n) + rng.bytes(2000) for n in range(200)]  # not compressible
    for number, data in enumerate(texts):
        write(made, TEXTS, data, number + 1, 0.2 * number)
        if number == 30:
            write(made, MAP, terrain(2), 2, 0.2 * number)
        if number % 10 == 0:
            made.flush()
            writer.wait()
    made.close()
    files = sorted((tmp_path / "dig").glob("*.mcap"))
    assert 4 <= len(files) <= 5
    read = []
    for file in files:
        reader = BagReader(file)
        assert [data for _, _, data in reader.raw_messages([CONFIG])][-1] == text(-1)
        assert read_maps(file)[-1] == decoded([terrain(2)])[0]
        read += [data for _, _, data in reader.raw_messages([TEXTS])]
    assert read == texts
    assert [data for _, _, data in BagReader(tmp_path / "dig").raw_messages([TEXTS])] == texts
    assert counts(tmp_path / "dig")[TEXTS] == 200  # by rosbags, from all files


def test_messages_out_of_order_begin_no_file_and_a_reset_of_time_does(tmp_path: Path) -> None:
    made = recording(tmp_path / "dig", max_bagfile_duration=10.0)
    for number, time in enumerate([50.0, 60.0, 59.9, 60.1, 59.8, 3.0, 4.0, 2.9]):
        write(made, TEXTS, text(number), number + 1, time)
    made.close()
    sizes = [
        BagReader(file).topics[TEXTS].count for file in sorted((tmp_path / "dig").glob("*.mcap"))
    ]
    assert sizes == [1, 4, 3]


def test_repeated_message_is_not_logged_before_it_was_published(tmp_path: Path) -> None:
    writer = BackgroundWriter(BagWriter(tmp_path / "dig"), 1 << 28)
    made = recording(tmp_path / "dig", writer, max_bagfile_size=1000)
    write(made, CONFIG, text(0, 100_000), 1, 10.0)
    made.flush()
    writer.wait()
    write(made, TEXTS, text(1), 1, 9.9)  # out of order; it begins the next file
    made.close()
    second = BagReader(tmp_path / "dig/dig_1.mcap")
    assert [time for _, time, _ in second.raw_messages([CONFIG])] == [10 * SECOND]


class SlowDisk(BagWriter):
    """Writes nothing until it is released."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.released = threading.Event()

    def write(self, *args, **kwargs) -> None:
        self.released.wait()
        super().write(*args, **kwargs)


def test_messages_beyond_the_queue_of_a_slow_disk_are_counted_as_lost(tmp_path: Path) -> None:
    disk = SlowDisk(tmp_path / "dig")
    writer = BackgroundWriter(disk, 1 << 20)
    made = BagRecording(writer, RecorderParams())
    made.add_topic(TEXTS, "std_msgs/msg/String", [], None)
    made.update_publishers(TEXTS, PUBLISHER, transient_local=False)
    for number in range(30):
        write(made, TEXTS, text(number, 100_000), number + 1, number)
    status = made.status()
    assert (status["messages"], status["num_lost"], status["lost"]) == (10, 20, {TEXTS: 20})
    assert 900_000 < status["bytes_queued"] <= 1 << 20
    disk.released.set()
    writer.wait()
    write(made, TEXTS, text(30), 31, 31.0)
    made.close()
    assert made.status()["bytes_queued"] == 0
    read = [int(message.data.split()[0]) for *_, message in BagReader(tmp_path / "dig")]
    assert read == [*range(10), 30]


@pytest.mark.parametrize("error", [BagError("there is no disk space"), ValueError("disk space")])
def test_failed_write_is_raised_once_and_the_rest_of_the_queue_is_dropped(
    tmp_path: Path, error: Exception
) -> None:
    class FullDisk(SlowDisk):
        def write(self, *args, **kwargs) -> None:
            self.released.wait()
            raise error

    disk = FullDisk(tmp_path / "dig")
    writer = BackgroundWriter(disk, 1 << 20)
    made = BagRecording(writer, RecorderParams(max_bagfile_duration=2.0))
    made.add_topic(TEXTS, "std_msgs/msg/String", [], None)
    for number in range(5):
        write(made, TEXTS, text(number), number + 1, number)
    disk.released.set()
    with pytest.raises(BagError, match="disk space") as raised:
        writer.wait()
    assert "ValueError" not in str(raised.value)
    assert made.has_failed
    made.close()
    assert len(list((tmp_path / "dig").glob("*.mcap"))) == 1  # no other file was begun
