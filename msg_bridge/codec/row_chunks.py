"""Chunks of rows as PointCloud2, with run and session.

Rows have the id of their machine, but not the run and session, which decide whether they are valid.
A cloud has no place for them except its points, so each point ends with `run_id`, and in streams of
one machine with `session_id`. The topic identifies the stream.
"""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time
from sensor_msgs.msg import PointCloud2

from msg_bridge.codec.cdr import cdr_to_rows, rows_to_cdr
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.point_cloud import from_point_cloud, to_point_cloud
from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.messages import STREAM_DTYPE, RowChunk, Stream
from msg_bridge.contract.rows import Rows

__all__ = ["chunk_dtype", "chunk_from_cdr", "chunk_to_cdr", "from_chunk_cloud", "to_chunk_cloud"]

_PER_MACHINE_STREAMS = (Stream.SWEEP, Stream.DEPOSIT_REQUEST, Stream.BACKLOG)

_MAX_UINT32 = 2**32 - 1


def _with_id_fields(stream: Stream) -> np.dtype[np.void]:
    names = ("run_id", "session_id") if stream in _PER_MACHINE_STREAMS else ("run_id",)
    return np.dtype([*STREAM_DTYPE[stream].descr, *((name, "<u4") for name in names)])


_CHUNK_DTYPE = {stream: _with_id_fields(stream) for stream in STREAM_DTYPE}


def chunk_dtype(stream: Stream) -> np.dtype[np.void]:
    """Return the dtype of the points of a stream: its row, `run_id`, and `session_id` if it is sent
    by, or to, one machine."""
    return _CHUNK_DTYPE[stream]


def to_chunk_cloud(chunk: RowChunk, frame_id: str, stamp: Time) -> PointCloud2:
    """Encode a chunk as a message.

    Raises:
        CodecError: EMPTY; DTYPE; VALUE: run or session id; SENDER_MISMATCH.
    """
    return to_point_cloud(_with_ids(chunk), frame_id, stamp)


def chunk_to_cdr(chunk: RowChunk, frame_id: str, stamp: Time) -> bytes:
    """Encode a chunk as a serialised message.

    Raises:
        CodecError: as `to_chunk_cloud`.
    """
    return rows_to_cdr(_with_ids(chunk), frame_id, stamp)


def _with_ids(chunk: RowChunk) -> Rows:
    """Return the rows of a chunk with run and session id."""
    dtype = STREAM_DTYPE.get(chunk.stream)
    if dtype is None or chunk.rows.dtype != dtype or chunk.rows.ndim != 1:
        raise CodecError(
            f"rows of dtype {chunk.rows.dtype} are not those of the stream {chunk.stream.name}",
            ErrorCode.DTYPE,
        )
    for name, value in (("run_id", chunk.run_id), ("session_id", chunk.session_id)):
        if not 0 <= value <= _MAX_UINT32:
            raise CodecError(
                f"{name} is {value}; give a number from 0 to 2**32 - 1", ErrorCode.VALUE
            )
    rows = np.empty(chunk.rows.size, dtype=chunk_dtype(chunk.stream))
    # Copying field by field would take three times as long.
    _bytes(rows)[:, : dtype.itemsize] = _bytes(np.ascontiguousarray(chunk.rows))
    rows["run_id"] = chunk.run_id
    if chunk.stream in _PER_MACHINE_STREAMS:
        rows["session_id"] = chunk.session_id
    if _sender_ids(rows, chunk.stream) != (chunk.run_id, chunk.machine_id, chunk.session_id):
        raise CodecError(
            f"a chunk of {chunk.stream.name} states machine {chunk.machine_id} and session"
            f" {chunk.session_id}; its rows are of another",
            ErrorCode.SENDER_MISMATCH,
        )
    return rows


def from_chunk_cloud(msg: PointCloud2, stream: Stream) -> RowChunk:
    """Decode a chunk from a message on the topic of a stream.

    Raises:
        CodecError: EMPTY; SENDER_MISMATCH; or as `from_point_cloud`.
    """
    return _chunk_from_rows(from_point_cloud(msg, chunk_dtype(stream)), stream)


def chunk_from_cdr(data: bytes, stream: Stream) -> RowChunk | None:
    """Decode a serialised chunk; None if its layout is not the usual one (`cdr_to_rows`).

    Raises:
        CodecError: EMPTY or SENDER_MISMATCH.
    """
    rows = cdr_to_rows(data, chunk_dtype(stream))
    return None if rows is None else _chunk_from_rows(rows, stream)


def _chunk_from_rows(rows: Rows, stream: Stream) -> RowChunk:
    run_id, machine_id, session_id = _sender_ids(rows, stream)
    stream_rows = np.empty(rows.size, dtype=STREAM_DTYPE[stream])
    _bytes(stream_rows)[:] = _bytes(rows)[:, : stream_rows.dtype.itemsize]
    return RowChunk(run_id, stream, machine_id, session_id, stream_rows)


def _sender_ids(rows: Rows, stream: Stream) -> tuple[int, int, int]:
    """Return (run id, machine id, session id) of a chunk; the last two are 0 if sent to all.

    Raises:
        CodecError: EMPTY or SENDER_MISMATCH.
    """
    if rows.size == 0:
        raise CodecError(
            f"a chunk of {stream.name} has no rows, and so no run id; send none", ErrorCode.EMPTY
        )
    names = (
        ("run_id", "machine_id", "session_id") if stream in _PER_MACHINE_STREAMS else ("run_id",)
    )
    for name in names:
        if (rows[name] != rows[name][0]).any():
            raise CodecError(
                f"a chunk of {stream.name} has rows of more than one {name}",
                ErrorCode.SENDER_MISMATCH,
            )
    first = {name: int(rows[name][0]) for name in names}
    return first["run_id"], first.get("machine_id", 0), first.get("session_id", 0)


def _bytes(rows: Rows) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
    """Return a view of the bytes of rows, shape (rows, bytes of one row), uint8."""
    return rows.view(np.uint8).reshape(rows.size, rows.dtype.itemsize)
