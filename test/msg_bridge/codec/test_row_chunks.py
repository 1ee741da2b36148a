"""Chunks of rows are transmitted with run, machine and session."""

import pytest
from builtin_interfaces.msg import Time
from support.wire import over_the_wire, raises, random_rows

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.point_cloud import to_point_cloud
from msg_bridge.codec.row_chunks import chunk_dtype, from_chunk_cloud, to_chunk_cloud
from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.messages import STREAM_DTYPE, RowChunk, Stream
from msg_bridge.contract.rows import DEPOSIT_REQUEST, empty_rows

STREAMS_OF_ONE_MACHINE = (Stream.SWEEP, Stream.DEPOSIT_REQUEST, Stream.BACKLOG)
STAMP = Time(sec=1)


def chunk_of(stream: Stream, count: int = 3) -> RowChunk:
    """Return rows of random bits with the largest run and session ids."""
    dtype = STREAM_DTYPE[stream]
    rows = random_rows(dtype, count)
    if stream not in STREAMS_OF_ONE_MACHINE:
        return RowChunk(2**32 - 1, stream, 0, 0, rows)
    rows["machine_id"] = 65535
    return RowChunk(2**32 - 1, stream, 65535, 2**32 - 2, rows)


def transmitted(chunk: RowChunk) -> RowChunk:
    return from_chunk_cloud(over_the_wire(to_chunk_cloud(chunk, "map", STAMP)), chunk.stream)


@pytest.mark.parametrize("stream", STREAM_DTYPE)
def test_chunk_of_every_stream_is_transmitted(stream: Stream) -> None:
    chunk = chunk_of(stream)
    back = transmitted(chunk)
    assert back.rows.dtype == STREAM_DTYPE[stream]
    assert back.rows.tobytes() == chunk.rows.tobytes()
    assert (back.run_id, back.stream) == (chunk.run_id, stream)
    assert (back.machine_id, back.session_id) == (chunk.machine_id, chunk.session_id)


def test_slice_of_an_array_is_transmitted() -> None:
    rows = chunk_of(Stream.MAP_UPDATE, 10).rows
    back = transmitted(RowChunk(1, Stream.MAP_UPDATE, 0, 0, rows[::3]))
    assert back.rows.tobytes() == rows[::3].tobytes()


def test_points_have_run_and_session() -> None:
    msg = to_chunk_cloud(chunk_of(Stream.DEPOSIT_REQUEST), "map", STAMP)
    assert [field.name for field in msg.fields] == [
        *(DEPOSIT_REQUEST.names or ()),
        "run_id",
        "session_id",
    ]


def test_chunk_without_rows_is_rejected() -> None:
    with raises(ErrorCode.EMPTY, CodecError):
        to_chunk_cloud(
            RowChunk(1, Stream.DEPOSIT_REQUEST, 1, 1, empty_rows(DEPOSIT_REQUEST)), "map", STAMP
        )
    msg = to_point_cloud(empty_rows(chunk_dtype(Stream.DEPOSIT_REQUEST)), "map", STAMP)
    with raises(ErrorCode.EMPTY, CodecError):
        from_chunk_cloud(msg, Stream.DEPOSIT_REQUEST)


@pytest.mark.parametrize("name", ["run_id", "machine_id", "session_id"])
def test_chunk_of_several_senders_is_rejected(name: str) -> None:
    rows = empty_rows(chunk_dtype(Stream.DEPOSIT_REQUEST), 2)
    rows[name][1] = 1
    with raises(ErrorCode.SENDER_MISMATCH, CodecError):
        from_chunk_cloud(to_point_cloud(rows, "map", STAMP), Stream.DEPOSIT_REQUEST)


def test_rows_of_another_machine_are_not_sent() -> None:
    rows = chunk_of(Stream.DEPOSIT_REQUEST).rows
    with raises(ErrorCode.SENDER_MISMATCH, CodecError):
        to_chunk_cloud(RowChunk(1, Stream.DEPOSIT_REQUEST, 7, 1, rows), "map", STAMP)


def test_rows_sent_to_all_have_no_machine() -> None:
    rows = chunk_of(Stream.CONVERSION).rows
    with raises(ErrorCode.SENDER_MISMATCH, CodecError):
        to_chunk_cloud(RowChunk(1, Stream.CONVERSION, 7, 1, rows), "map", STAMP)


def test_rows_of_another_stream_are_not_sent() -> None:
    rows = chunk_of(Stream.CONVERSION).rows
    with raises(ErrorCode.DTYPE, CodecError):
        to_chunk_cloud(RowChunk(1, Stream.MAP_UPDATE, 0, 0, rows), "map", STAMP)


@pytest.mark.parametrize(("run_id", "session_id"), [(-1, 1), (2**32, 1), (1, -1), (1, 2**32)])
def test_ids_out_of_range_are_not_sent(run_id: int, session_id: int) -> None:
    rows = chunk_of(Stream.DEPOSIT_REQUEST).rows
    with raises(ErrorCode.VALUE, CodecError):
        to_chunk_cloud(
            RowChunk(run_id, Stream.DEPOSIT_REQUEST, 65535, session_id, rows), "map", STAMP
        )
