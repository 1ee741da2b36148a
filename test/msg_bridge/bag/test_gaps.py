"""Every loss that can be told is counted; nothing that got lost nowhere ever is."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2, PointField

from msg_bridge.bag.gaps import Gaps
from msg_bridge.codec.chunks import to_chunk_cloud
from msg_bridge.codec.point_cloud import to_point_cloud
from msg_bridge.contract.messages import STREAM_DTYPE, RowChunk, Stream
from msg_bridge.contract.rows import Rows, empty_rows

TOPIC = "/topic"
A, B = frozenset({b"A"}), frozenset({b"B"})
CLOUD = "sensor_msgs/msg/PointCloud2"


class Plain:
    """A topic of messages that only their publisher numbers."""

    def __init__(self, publishers: frozenset[bytes] = A) -> None:
        self.gaps = Gaps()
        self.gaps.add_topic(TOPIC, "std_msgs/msg/String")
        self.gaps.see_publishers(TOPIC, publishers)

    def hear(self, *numbers: int) -> None:
        for number in numbers:
            self.gaps.add(TOPIC, b"", number)

    def lost(self, publishers: frozenset[bytes] = A) -> int:
        """Losses once the graph was looked at."""
        self.gaps.see_publishers(TOPIC, publishers)
        return self.gaps.lost.get(TOPIC, 0)


def test_jump_in_a_publishers_numbers_is_a_loss():
    topic = Plain()
    topic.hear(1, 2, 5, 6, 8)
    assert topic.lost() == 3
    topic.hear(9, 20)
    assert topic.lost() == 13
    assert topic.gaps.total == 13


def test_messages_before_the_first_heard_are_no_loss():
    topic = Plain()
    topic.hear(1000, 1001)
    assert topic.lost() == 0
    assert topic.gaps.lost == {}


@pytest.mark.parametrize("first", [1, 3, 300])
def test_publisher_that_starts_again_is_no_loss(first):
    topic = Plain()
    topic.hear(1, 2)
    assert topic.lost() == 0
    topic.hear(first, first + 1)  # before the graph has shown that it is another
    assert topic.lost(B) == 0
    topic.hear(first + 2)
    assert topic.lost(B) == 0


def test_loss_after_a_restart_is_counted():
    topic = Plain()
    topic.hear(1, 2, 3)
    topic.lost(B)
    topic.hear(1, 2, 5)
    assert topic.lost(B) == 2


def test_publisher_that_came_and_went_between_two_looks_is_no_loss():
    topic = Plain()
    topic.hear(100, 1, 101, 2, 102)
    assert topic.lost() == 0
    topic.hear(103)
    assert topic.lost() == 0


def test_nothing_is_counted_or_hidden_while_several_publish():
    topic = Plain(A | B)
    topic.hear(1, 50, 2, 51, 9)
    assert topic.lost(A | B) == 0
    assert topic.gaps.uncounted == (TOPIC,)
    topic.hear(52, 90)
    assert topic.lost(A) == 0  # B has left
    assert topic.gaps.uncounted == ()


def test_middleware_without_numbers_has_no_losses():
    topic = Plain()
    topic.hear(0, 0, 0)
    assert topic.lost() == 0


def chunk(stream: Stream, seq: np.ndarray, *, source=0, life=0, epoch=1) -> bytes:
    """A chunk of rows of these numbers, as it comes."""
    rows: Rows = empty_rows(STREAM_DTYPE[stream], len(seq))
    rows["seq"] = np.asarray(seq) % 2**32
    if source:
        rows["source"] = source
    # The frame's name moves all that follows.
    cloud = to_chunk_cloud(RowChunk(epoch, stream, source, life, rows), "map" + "p" * life, Time())
    return serialize_message(cloud)


class Clouds:
    """A topic of rows; every message is numbered far from the one before, as if many sent."""

    def __init__(self) -> None:
        self.gaps = Gaps()
        self.gaps.add_topic(TOPIC, CLOUD)
        self.gaps.see_publishers(TOPIC, A)
        self._number = 0

    def hear(self, data: bytes) -> None:
        self._number += 100
        self.gaps.add(TOPIC, data, self._number)

    def rows(self, first: int, last: int, **kwargs) -> None:
        kwargs.setdefault("stream", Stream.CONVERSION)
        self.hear(chunk(seq=np.arange(first, last + 1), **kwargs))

    @property
    def lost(self) -> int:
        self.gaps.see_publishers(TOPIC, A)
        return self.gaps.total


@pytest.mark.parametrize("stream", STREAM_DTYPE)
def test_missing_rows_are_counted_in_every_stream(stream):
    topic = Clouds()
    kwargs = {"source": 3, "life": 2} if stream in (1, 2, 6) else {}
    topic.rows(1, 4, stream=stream, **kwargs)
    topic.rows(5, 5, stream=stream, **kwargs)
    assert topic.lost == 0
    topic.rows(10, 12, stream=stream, **kwargs)
    assert topic.lost == 4


def test_rows_sent_again_are_no_longer_missing():
    topic = Clouds()
    topic.rows(1, 10)
    topic.rows(21, 30)
    topic.rows(41, 50)
    assert topic.lost == 20
    topic.rows(8, 13)
    assert topic.lost == 17
    topic.rows(16, 18)
    assert topic.lost == 14
    topic.rows(14, 45)
    assert topic.lost == 0
    topic.rows(51, 60)
    assert topic.lost == 0


def test_holes_within_a_chunk_are_counted():
    topic = Clouds()
    topic.rows(1, 3)
    topic.hear(chunk(Stream.CONVERSION, np.array([4, 5, 9, 10, 8, 20])))
    assert topic.lost == (9 - 6) - 1 + (20 - 11)


def test_machines_on_one_topic_are_counted_each():
    topic = Clouds()
    for first in (1, 11, 21):
        for source in (1, 2, 7):
            topic.rows(first, first + 9, stream=Stream.SWEEP, source=source, life=source)
    assert topic.lost == 0
    topic.rows(34, 40, stream=Stream.SWEEP, source=2, life=2)
    assert topic.lost == 3


def test_new_life_begins_with_row_1():
    topic = Clouds()
    topic.rows(500, 510, stream=Stream.LANDED, source=1, life=4)
    topic.rows(1, 9, stream=Stream.LANDED, source=1, life=5)
    topic.rows(520, 530, stream=Stream.LANDED, source=1, life=4)  # too late to count
    assert topic.lost == 0
    topic.rows(3, 9, stream=Stream.LANDED, source=1, life=8)
    assert topic.lost == 2


def test_new_epoch_begins_with_row_1_and_keeps_the_losses_of_the_old():
    topic = Clouds()
    topic.rows(1, 5, epoch=10)
    topic.rows(8, 9, epoch=10)
    topic.rows(1, 5, epoch=11)
    topic.rows(6, 7, epoch=11)
    assert topic.lost == 2
    topic.rows(9, 9, epoch=11)
    assert topic.lost == 3


def test_rows_before_the_first_heard_are_no_loss():
    topic = Clouds()
    topic.rows(700, 710)
    topic.rows(711, 720)
    assert topic.lost == 0


def test_numbers_go_on_past_32_bits():
    topic = Clouds()
    topic.rows(2**32 - 5, 2**32 - 2)
    topic.rows(2**32 - 1, 2**32 + 3)
    topic.rows(2**32 + 4, 2**32 + 6)
    assert topic.lost == 0
    topic.rows(2**32 + 9, 2**32 + 9)
    assert topic.lost == 2


def test_number_no_stream_can_have_reached_is_no_loss():
    topic = Clouds()
    topic.rows(1, 5)
    topic.rows(1_000_000_000, 1_000_000_001)
    topic.rows(1_000_000_002, 1_000_000_002)
    assert topic.lost == 0


def test_more_holes_than_are_remembered_are_counted_all():
    topic = Clouds()
    for seq in range(1, 2001, 2):
        topic.rows(seq, seq)
    assert topic.lost == 999


def test_rows_on_a_topic_of_several_publishers_are_counted():
    topic = Clouds()
    topic.gaps.see_publishers(TOPIC, A | B)
    topic.rows(1, 2)
    topic.rows(4, 5)
    assert topic.gaps.lost == {TOPIC: 1}
    assert topic.gaps.uncounted == ()


def test_clouds_without_numbered_rows_are_counted_by_their_publishers_numbers():
    topic = Clouds()
    points = np.zeros(3, [("x", "<f4"), ("seq", "<f4"), ("epoch", "<u4")])
    for _ in range(3):
        topic.hear(serialize_message(to_point_cloud(points, "map", Time())))
    assert topic.lost == 2 * 99


@pytest.mark.parametrize(
    "cloud",
    [
        PointCloud2(),
        PointCloud2(fields=[PointField(name="seq", datatype=6), PointField(name="epoch")]),
        PointCloud2(
            fields=[PointField(name=name, datatype=6, count=1) for name in ("seq", "epoch")],
            point_step=8,
            is_bigendian=True,
        ),
    ],
)
def test_odd_clouds_do_no_harm(cloud):
    topic = Clouds()
    topic.hear(serialize_message(cloud))
    assert topic.lost == 0


def test_odd_or_cut_clouds_amid_rows_change_nothing():
    topic = Clouds()
    topic.rows(1, 5)
    topic.hear(serialize_message(PointCloud2()))
    whole = chunk(Stream.CONVERSION, np.arange(6, 50))
    for length in range(len(whole)):
        topic.hear(whole[:length])
    topic.rows(7, 8)
    assert topic.lost == 1
