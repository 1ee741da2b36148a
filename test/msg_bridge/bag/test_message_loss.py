"""All losses that sequence numbers show are counted, and nothing else is."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2, PointField

from msg_bridge.bag.message_loss import MessageLossCounter
from msg_bridge.codec.point_cloud import to_point_cloud
from msg_bridge.codec.row_chunks import to_chunk_cloud
from msg_bridge.contract.messages import STREAM_DTYPE, RowChunk, Stream
from msg_bridge.contract.rows import Rows, empty_rows

TOPIC = "/topic"
A, B = frozenset({b"A"}), frozenset({b"B"})
CLOUD = "sensor_msgs/msg/PointCloud2"


class MessageTopic:
    """A topic whose messages are numbered by their publisher only."""

    def __init__(self, publishers: frozenset[bytes] = A) -> None:
        self.loss_counter = MessageLossCounter()
        self.loss_counter.add_topic(TOPIC, "std_msgs/msg/String")
        self.loss_counter.update_publishers(TOPIC, publishers)

    def receive(self, *numbers: int) -> None:
        """Receive messages with these sequence numbers."""
        for number in numbers:
            self.loss_counter.add(TOPIC, b"", number)

    def lost(self, publishers: frozenset[bytes] = A) -> int:
        """Return the losses after an update from the graph."""
        self.loss_counter.update_publishers(TOPIC, publishers)
        return self.loss_counter.lost.get(TOPIC, 0)


def test_gap_in_a_publishers_numbers_is_a_loss():
    topic = MessageTopic()
    topic.receive(1, 2, 5, 6, 8)
    assert topic.lost() == 3
    topic.receive(9, 20)
    assert topic.lost() == 13
    assert topic.loss_counter.total == 13


def test_messages_before_the_first_received_one_are_no_loss():
    topic = MessageTopic()
    topic.receive(1000, 1001)
    assert topic.lost() == 0
    assert topic.loss_counter.lost == {}


@pytest.mark.parametrize("first", [1, 3, 300])
def test_restarted_publisher_is_no_loss(first):
    topic = MessageTopic()
    topic.receive(1, 2)
    assert topic.lost() == 0
    topic.receive(first, first + 1)  # before the graph shows the new publisher
    assert topic.lost(B) == 0
    topic.receive(first + 2)
    assert topic.lost(B) == 0


def test_loss_after_a_restart_is_counted():
    topic = MessageTopic()
    topic.receive(1, 2, 3)
    topic.lost(B)
    topic.receive(1, 2, 5)
    assert topic.lost(B) == 2


def test_publisher_that_exists_only_between_two_updates_is_no_loss():
    topic = MessageTopic()
    topic.receive(100, 1, 101, 2, 102)
    assert topic.lost() == 0
    topic.receive(103)
    assert topic.lost() == 0


def test_nothing_is_counted_while_several_publish():
    topic = MessageTopic(A | B)
    topic.receive(1, 50, 2, 51, 9)
    assert topic.lost(A | B) == 0
    assert topic.loss_counter.uncounted == (TOPIC,)
    topic.receive(52, 90)
    assert topic.lost(A) == 0  # B has left
    assert topic.loss_counter.uncounted == ()


def test_middleware_without_numbers_has_no_losses():
    topic = MessageTopic()
    topic.receive(0, 0, 0)
    assert topic.lost() == 0


def chunk(stream: Stream, seq: np.ndarray, *, machine_id=0, session_id=0, run_id=1) -> bytes:
    """Return the CDR bytes of a chunk of rows with these numbers."""
    rows: Rows = empty_rows(STREAM_DTYPE[stream], len(seq))
    rows["seq"] = np.asarray(seq) % 2**32
    if machine_id:
        rows["machine_id"] = machine_id
    # The length of the frame id shifts everything after it.
    cloud = to_chunk_cloud(
        RowChunk(run_id, stream, machine_id, session_id, rows), "map" + "p" * session_id, Time()
    )
    return serialize_message(cloud)


class RowTopic:
    """A topic of rows; gaps between its message numbers are large, as with many publishers."""

    def __init__(self) -> None:
        self.loss_counter = MessageLossCounter()
        self.loss_counter.add_topic(TOPIC, CLOUD)
        self.loss_counter.update_publishers(TOPIC, A)
        self._number = 0

    def receive(self, data: bytes) -> None:
        """Receive a message."""
        self._number += 100
        self.loss_counter.add(TOPIC, data, self._number)

    def rows(self, first: int, last: int, **kwargs) -> None:
        kwargs.setdefault("stream", Stream.CONVERSION)
        self.receive(chunk(seq=np.arange(first, last + 1), **kwargs))

    @property
    def lost(self) -> int:
        self.loss_counter.update_publishers(TOPIC, A)
        return self.loss_counter.total


@pytest.mark.parametrize("stream", STREAM_DTYPE)
def test_missing_rows_are_counted_in_every_stream(stream):
    topic = RowTopic()
    kwargs = {"machine_id": 3, "session_id": 2} if stream in (1, 2, 6) else {}
    topic.rows(1, 4, stream=stream, **kwargs)
    topic.rows(5, 5, stream=stream, **kwargs)
    assert topic.lost == 0
    topic.rows(10, 12, stream=stream, **kwargs)
    assert topic.lost == 4


def test_retransmitted_rows_are_no_longer_missing():
    topic = RowTopic()
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


def test_gaps_within_a_chunk_are_counted():
    topic = RowTopic()
    topic.rows(1, 3)
    topic.receive(chunk(Stream.CONVERSION, np.array([4, 5, 9, 10, 8, 20])))
    assert topic.lost == (9 - 6) - 1 + (20 - 11)


def test_machines_on_one_topic_are_counted_separately():
    topic = RowTopic()
    for first in (1, 11, 21):
        for machine_id in (1, 2, 7):
            topic.rows(
                first, first + 9, stream=Stream.SWEEP, machine_id=machine_id, session_id=machine_id
            )
    assert topic.lost == 0
    topic.rows(34, 40, stream=Stream.SWEEP, machine_id=2, session_id=2)
    assert topic.lost == 3


def test_new_session_begins_with_row_1():
    topic = RowTopic()
    topic.rows(500, 510, stream=Stream.DEPOSIT_REQUEST, machine_id=1, session_id=4)
    topic.rows(1, 9, stream=Stream.DEPOSIT_REQUEST, machine_id=1, session_id=5)
    topic.rows(
        520, 530, stream=Stream.DEPOSIT_REQUEST, machine_id=1, session_id=4
    )  # too late to count
    assert topic.lost == 0
    topic.rows(3, 9, stream=Stream.DEPOSIT_REQUEST, machine_id=1, session_id=8)
    assert topic.lost == 2


def test_new_run_begins_with_row_1_and_keeps_the_losses_of_the_old():
    topic = RowTopic()
    topic.rows(1, 5, run_id=10)
    topic.rows(8, 9, run_id=10)
    topic.rows(1, 5, run_id=11)
    topic.rows(6, 7, run_id=11)
    assert topic.lost == 2
    topic.rows(9, 9, run_id=11)
    assert topic.lost == 3


def test_rows_before_the_first_received_one_are_no_loss():
    topic = RowTopic()
    topic.rows(700, 710)
    topic.rows(711, 720)
    assert topic.lost == 0


def test_row_numbers_wrap_at_2_to_the_32():
    topic = RowTopic()
    topic.rows(2**32 - 5, 2**32 - 2)
    topic.rows(2**32 - 1, 2**32 + 3)
    topic.rows(2**32 + 4, 2**32 + 6)
    assert topic.lost == 0
    topic.rows(2**32 + 9, 2**32 + 9)
    assert topic.lost == 2


def test_impossibly_large_step_is_no_loss():
    topic = RowTopic()
    topic.rows(1, 5)
    topic.rows(1_000_000_000, 1_000_000_001)
    topic.rows(1_000_000_002, 1_000_000_002)
    assert topic.lost == 0


def test_more_gaps_than_are_stored_are_all_counted():
    topic = RowTopic()
    for seq in range(1, 2001, 2):
        topic.rows(seq, seq)
    assert topic.lost == 999


def test_rows_on_a_topic_of_several_publishers_are_counted():
    topic = RowTopic()
    topic.loss_counter.update_publishers(TOPIC, A | B)
    topic.rows(1, 2)
    topic.rows(4, 5)
    assert topic.loss_counter.lost == {TOPIC: 1}
    assert topic.loss_counter.uncounted == ()


def test_clouds_without_numbered_rows_are_counted_by_their_publishers_numbers():
    topic = RowTopic()
    points = np.zeros(3, [("x", "<f4"), ("seq", "<f4"), ("run_id", "<u4")])
    for _ in range(3):
        topic.receive(serialize_message(to_point_cloud(points, "map", Time())))
    assert topic.lost == 2 * 99


@pytest.mark.parametrize(
    "cloud",
    [
        PointCloud2(),
        PointCloud2(fields=[PointField(name="seq", datatype=6), PointField(name="run_id")]),
        PointCloud2(
            fields=[PointField(name=name, datatype=6, count=1) for name in ("seq", "run_id")],
            point_step=8,
            is_bigendian=True,
        ),
    ],
)
def test_invalid_clouds_are_ignored(cloud):
    topic = RowTopic()
    topic.receive(serialize_message(cloud))
    assert topic.lost == 0


def test_invalid_or_truncated_clouds_among_rows_are_ignored():
    topic = RowTopic()
    topic.rows(1, 5)
    topic.receive(serialize_message(PointCloud2()))
    complete = chunk(Stream.CONVERSION, np.arange(6, 50))
    for length in range(len(complete)):
        topic.receive(complete[:length])
    topic.rows(7, 8)
    assert topic.lost == 1
