"""Chunks of rows cross with the run, machine and life they belong to."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.point_cloud import to_point_cloud
from msg_bridge.codec.row_chunks import chunk_dtype, from_chunk_cloud, to_chunk_cloud
from msg_bridge.contract.messages import STREAM_DTYPE, RowChunk, Stream
from msg_bridge.contract.rows import DEPOSIT_REQUEST, empty_rows

OF_ONE_MACHINE = (Stream.SWEEP, Stream.DEPOSIT_REQUEST, Stream.BACKLOG)
STAMP = Time(sec=1)


def chunk_of(stream: Stream, count: int = 3) -> RowChunk:
    """Rows of random bits, in the largest epoch and life a point can hold."""
    dtype = STREAM_DTYPE[stream]
    raw = np.random.default_rng(1).integers(0, 256, count * dtype.itemsize, dtype=np.uint8)
    rows = raw.view(dtype)
    if stream not in OF_ONE_MACHINE:
        return RowChunk(2**32 - 1, stream, 0, 0, rows)
    rows["machine_id"] = 65535
    return RowChunk(2**32 - 1, stream, 65535, 2**32 - 2, rows)


def crossed(chunk: RowChunk) -> RowChunk:
    msg = serialize_message(to_chunk_cloud(chunk, "map", STAMP))
    return from_chunk_cloud(deserialize_message(msg, PointCloud2), chunk.stream)


@pytest.mark.parametrize("stream", STREAM_DTYPE)
def test_chunk_of_every_stream_crosses(stream: Stream) -> None:
    chunk = chunk_of(stream)
    back = crossed(chunk)
    assert back.rows.dtype == STREAM_DTYPE[stream]
    assert back.rows.tobytes() == chunk.rows.tobytes()
    assert (back.run_id, back.stream) == (chunk.run_id, stream)
    assert (back.machine_id, back.session_id) == (chunk.machine_id, chunk.session_id)


def test_slice_of_an_array_crosses() -> None:
    rows = chunk_of(Stream.MAP_UPDATE, 10).rows
    back = crossed(RowChunk(1, Stream.MAP_UPDATE, 0, 0, rows[::3]))
    assert back.rows.tobytes() == rows[::3].tobytes()


def test_points_name_run_and_life() -> None:
    msg = to_chunk_cloud(chunk_of(Stream.DEPOSIT_REQUEST), "map", STAMP)
    assert [field.name for field in msg.fields] == [
        *(DEPOSIT_REQUEST.names or ()),
        "run_id",
        "session_id",
    ]


def test_chunk_without_rows_is_refused() -> None:
    with pytest.raises(CodecError, match="has no rows"):
        to_chunk_cloud(
            RowChunk(1, Stream.DEPOSIT_REQUEST, 1, 1, empty_rows(DEPOSIT_REQUEST)), "map", STAMP
        )
    msg = to_point_cloud(empty_rows(chunk_dtype(Stream.DEPOSIT_REQUEST)), "map", STAMP)
    with pytest.raises(CodecError, match="has no rows"):
        from_chunk_cloud(msg, Stream.DEPOSIT_REQUEST)


@pytest.mark.parametrize("name", ["run_id", "machine_id", "session_id"])
def test_mixed_chunk_is_refused(name: str) -> None:
    rows = empty_rows(chunk_dtype(Stream.DEPOSIT_REQUEST), 2)
    rows[name][1] = 1
    with pytest.raises(CodecError, match=f"more than one {name}"):
        from_chunk_cloud(to_point_cloud(rows, "map", STAMP), Stream.DEPOSIT_REQUEST)


def test_rows_of_another_machine_are_not_sent() -> None:
    rows = chunk_of(Stream.DEPOSIT_REQUEST).rows
    with pytest.raises(CodecError, match="said to be of machine 7"):
        to_chunk_cloud(RowChunk(1, Stream.DEPOSIT_REQUEST, 7, 1, rows), "map", STAMP)


def test_rows_to_all_are_of_no_machine() -> None:
    rows = chunk_of(Stream.CONVERSION).rows
    with pytest.raises(CodecError, match="said to be of machine 7"):
        to_chunk_cloud(RowChunk(1, Stream.CONVERSION, 7, 1, rows), "map", STAMP)


def test_rows_of_another_stream_are_not_sent() -> None:
    rows = chunk_of(Stream.CONVERSION).rows
    with pytest.raises(CodecError, match="not what the MAP_UPDATE stream carries"):
        to_chunk_cloud(RowChunk(1, Stream.MAP_UPDATE, 0, 0, rows), "map", STAMP)


@pytest.mark.parametrize(("run_id", "session_id"), [(-1, 1), (2**32, 1), (1, -1), (1, 2**32)])
def test_number_too_large_for_a_point_is_not_sent(run_id: int, session_id: int) -> None:
    rows = chunk_of(Stream.DEPOSIT_REQUEST).rows
    with pytest.raises(CodecError, match="does not fit 32 bits"):
        to_chunk_cloud(
            RowChunk(run_id, Stream.DEPOSIT_REQUEST, 65535, session_id, rows), "map", STAMP
        )
