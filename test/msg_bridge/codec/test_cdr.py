"""The bytes made here are those of rclpy's own serialisation, and are read back."""

import array

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Int64MultiArray

from msg_bridge.codec.cdr import cdr_to_array, cdr_to_rows, rows_to_cdr
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.point_cloud import from_point_cloud, to_point_cloud
from msg_bridge.codec.row_chunks import (
    chunk_from_cdr,
    chunk_to_cdr,
    from_chunk_cloud,
    to_chunk_cloud,
)
from msg_bridge.codec.tick_headers import message_from_cdr, message_to_cdr, to_multi_array
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import (
    STREAM_DTYPE,
    MachineHeader,
    MachineReceipt,
    RetransmitRequest,
    RowChunk,
    RowRange,
    SoilHeader,
    Stream,
    Verb,
)

STAMP = Time(sec=12, nanosec=340_000_000)
RECEIPTS = tuple(MachineReceipt(n, 7, 1, 2, 3) for n in range(3))
MESSAGES = (
    MachineHeader(1, 2, 3, -1, Verb.STEP, RowRange(5, 6), RowRange(7, 8), 9, -(2**63), 12),
    *(
        SoilHeader(1, 5, 9, RowRange(11, 2), RowRange(21, 3), RowRange(31, 4), RECEIPTS[:n])
        for n in range(4)
    ),
    RetransmitRequest(1, 2, 7, Stream.DEPOSIT_REQUEST, 120, 40),
    Ledger(1, 5, 2**62, -3, 4, 5, 6, 7, 2**62, 3, 500),
)


def random_rows(dtype, count):
    raw = np.random.default_rng(count).integers(0, 256, (count, dtype.itemsize), dtype=np.uint8)
    return raw.reshape(-1).view(dtype)


@pytest.mark.parametrize("stream", STREAM_DTYPE)
@pytest.mark.parametrize("count", [0, 1, 7])
@pytest.mark.parametrize("frame", ["", "map", "site/excavator_2"])
def test_rows_are_the_bytes_of_the_cloud(stream, count, frame):
    rows = random_rows(STREAM_DTYPE[stream], count)
    data = rows_to_cdr(rows, frame, STAMP)
    ours = deserialize_message(data, PointCloud2)
    assert ours == deserialize_message(
        serialize_message(to_point_cloud(rows, frame, STAMP)), PointCloud2
    )
    assert from_point_cloud(ours, rows.dtype).tobytes() == rows.tobytes()


def test_they_are_as_long_as_those_of_rclpy():
    rows = random_rows(STREAM_DTYPE[Stream.FORCE], 3)
    theirs = serialize_message(to_point_cloud(rows, "map", STAMP))
    assert len(rows_to_cdr(rows, "map", STAMP)) == len(theirs)


@pytest.mark.parametrize("stream", STREAM_DTYPE)
@pytest.mark.parametrize("count", [0, 1, 7])
def test_rows_are_read_from_what_rclpy_sends(stream, count):
    rows = random_rows(STREAM_DTYPE[stream], count)
    data = bytes(serialize_message(to_point_cloud(rows, "map", STAMP)))
    assert cdr_to_rows(data, rows.dtype).tobytes() == rows.tobytes()


def test_other_fields_are_left_to_the_slow_way():
    data = rows_to_cdr(random_rows(STREAM_DTYPE[Stream.FORCE], 2), "map", STAMP)
    assert cdr_to_rows(data, STREAM_DTYPE[Stream.DEPOSIT_REQUEST]) is None


@pytest.mark.parametrize("part", [0, 3, 11, 15, 30, 200, -1])
def test_cut_bytes_are_not_read(part):
    data = rows_to_cdr(random_rows(STREAM_DTYPE[Stream.DEPOSIT_REQUEST], 2), "map", STAMP)
    assert cdr_to_rows(data[:part], STREAM_DTYPE[Stream.DEPOSIT_REQUEST]) is None


def test_a_length_that_lies_is_not_believed():
    data = bytearray(
        rows_to_cdr(random_rows(STREAM_DTYPE[Stream.DEPOSIT_REQUEST], 2), "map", STAMP)
    )
    data[12:16] = b"\xff\xff\xff\xff"
    assert cdr_to_rows(bytes(data), STREAM_DTYPE[Stream.DEPOSIT_REQUEST]) is None


def test_a_chunk_crosses_as_bytes():
    rows = random_rows(STREAM_DTYPE[Stream.DEPOSIT_REQUEST], 5)
    rows["machine_id"] = 2
    chunk = RowChunk(4, Stream.DEPOSIT_REQUEST, 2, 9, rows)
    data = chunk_to_cdr(chunk, "map", STAMP)
    for back in (
        chunk_from_cdr(data, Stream.DEPOSIT_REQUEST),
        chunk_from_cdr(
            bytes(serialize_message(to_chunk_cloud(chunk, "map", STAMP))), Stream.DEPOSIT_REQUEST
        ),
        from_chunk_cloud(deserialize_message(data, PointCloud2), Stream.DEPOSIT_REQUEST),
    ):
        assert (back.run_id, back.machine_id, back.session_id) == (4, 2, 9)
        assert back.rows.tobytes() == rows.tobytes()


def test_a_chunk_without_rows_is_refused():
    data = rows_to_cdr(random_rows(STREAM_DTYPE[Stream.DEPOSIT_REQUEST], 0), "map", STAMP)
    assert (
        chunk_from_cdr(data, Stream.DEPOSIT_REQUEST) is None
    )  # without its tags it is another cloud


@pytest.mark.parametrize("message", MESSAGES)
def test_headers_are_the_bytes_of_the_array(message):
    data = message_to_cdr(message)
    msg = to_multi_array(message)
    assert deserialize_message(data, Int64MultiArray) == deserialize_message(
        serialize_message(msg), Int64MultiArray
    )
    assert message_from_cdr(data) == message
    assert message_from_cdr(bytes(serialize_message(msg))) == message


def test_a_wrong_array_is_refused_as_ever():
    msg = to_multi_array(MESSAGES[0])
    msg.data = array.array("q", [99, *msg.data[1:]])
    with pytest.raises(CodecError, match="kinds are"):
        message_from_cdr(bytes(serialize_message(msg)))


@pytest.mark.parametrize("part", [0, 3, 9, 20, 60, -1])
def test_a_cut_array_is_not_read(part):
    assert cdr_to_array(message_to_cdr(MESSAGES[0])[:part]) is None


def test_an_array_of_two_dimensions_is_left_to_the_slow_way():
    msg = to_multi_array(MESSAGES[0])
    msg.layout.dim = [*msg.layout.dim, *msg.layout.dim]
    assert cdr_to_array(bytes(serialize_message(msg))) is None
