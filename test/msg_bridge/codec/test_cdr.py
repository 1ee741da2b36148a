"""Serialised bytes equal those of rclpy and are parsed back."""

import array

import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Int64MultiArray
from support.wire import raises, random_rows

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
from msg_bridge.contract.errors import ErrorCode
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


@pytest.mark.parametrize("stream", STREAM_DTYPE)
@pytest.mark.parametrize("count", [0, 1, 7])
@pytest.mark.parametrize("frame", ["", "map", "site/excavator_2"])
def test_rows_are_the_bytes_of_the_cloud(stream, count, frame):
    rows = random_rows(STREAM_DTYPE[stream], count)
    data = rows_to_cdr(rows, frame, STAMP)
    decoded = deserialize_message(data, PointCloud2)
    assert decoded == deserialize_message(
        serialize_message(to_point_cloud(rows, frame, STAMP)), PointCloud2
    )
    assert from_point_cloud(decoded, rows.dtype).tobytes() == rows.tobytes()


def test_length_equals_that_of_rclpy():
    rows = random_rows(STREAM_DTYPE[Stream.FORCE], 3)
    expected = serialize_message(to_point_cloud(rows, "map", STAMP))
    assert len(rows_to_cdr(rows, "map", STAMP)) == len(expected)


@pytest.mark.parametrize("stream", STREAM_DTYPE)
@pytest.mark.parametrize("count", [0, 1, 7])
def test_rows_are_parsed_from_bytes_of_rclpy(stream, count):
    rows = random_rows(STREAM_DTYPE[stream], count)
    data = bytes(serialize_message(to_point_cloud(rows, "map", STAMP)))
    assert cdr_to_rows(data, rows.dtype).tobytes() == rows.tobytes()


def test_other_fields_are_not_parsed():
    data = rows_to_cdr(random_rows(STREAM_DTYPE[Stream.FORCE], 2), "map", STAMP)
    assert cdr_to_rows(data, STREAM_DTYPE[Stream.DEPOSIT_REQUEST]) is None


@pytest.mark.parametrize("part", [0, 3, 11, 15, 30, 200, -1])
def test_truncated_cloud_is_not_parsed(part):
    data = rows_to_cdr(random_rows(STREAM_DTYPE[Stream.DEPOSIT_REQUEST], 2), "map", STAMP)
    assert cdr_to_rows(data[:part], STREAM_DTYPE[Stream.DEPOSIT_REQUEST]) is None


def test_wrong_length_is_not_parsed():
    data = bytearray(
        rows_to_cdr(random_rows(STREAM_DTYPE[Stream.DEPOSIT_REQUEST], 2), "map", STAMP)
    )
    data[12:16] = b"\xff\xff\xff\xff"
    assert cdr_to_rows(bytes(data), STREAM_DTYPE[Stream.DEPOSIT_REQUEST]) is None


def test_chunk_is_transmitted_as_bytes():
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


def test_rows_without_ids_are_not_parsed():
    data = rows_to_cdr(random_rows(STREAM_DTYPE[Stream.DEPOSIT_REQUEST], 0), "map", STAMP)
    assert chunk_from_cdr(data, Stream.DEPOSIT_REQUEST) is None


@pytest.mark.parametrize("message", MESSAGES)
def test_headers_are_the_bytes_of_the_array(message):
    data = message_to_cdr(message)
    msg = to_multi_array(message)
    assert deserialize_message(data, Int64MultiArray) == deserialize_message(
        serialize_message(msg), Int64MultiArray
    )
    assert message_from_cdr(data) == message
    assert message_from_cdr(bytes(serialize_message(msg))) == message


def test_array_of_unknown_kind_is_rejected():
    msg = to_multi_array(MESSAGES[0])
    msg.data = array.array("q", [99, *msg.data[1:]])
    with raises(ErrorCode.MESSAGE_KIND, CodecError):
        message_from_cdr(bytes(serialize_message(msg)))


@pytest.mark.parametrize("part", [0, 3, 9, 20, 60, -1])
def test_truncated_array_is_not_parsed(part):
    assert cdr_to_array(message_to_cdr(MESSAGES[0])[:part]) is None


def test_array_of_two_dimensions_is_not_parsed():
    msg = to_multi_array(MESSAGES[0])
    msg.layout.dim = [*msg.layout.dim, *msg.layout.dim]
    assert cdr_to_array(bytes(serialize_message(msg))) is None
