"""Chunks of rows as PointCloud2, with whose they are.

Rows name their source but not the run (epoch) and the machine's life they belong to, which decide
whether they count at all, and a cloud has no room for either but its points. So each point ends
with them: `epoch`, and in streams of one machine `life`. What the soil sends to all belongs to no
life. The stream is told by the topic.
"""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time
from sensor_msgs.msg import PointCloud2

from msg_bridge.codec.cdr import cdr_to_rows, rows_to_cdr
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.point_cloud import from_point_cloud, to_point_cloud
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
    """What a point of a stream's cloud holds: its row, `epoch`, and `life` of one machine's."""
    return _CHUNK_DTYPE[stream]


def to_chunk_cloud(chunk: RowChunk, frame_id: str, stamp: Time) -> PointCloud2:
    """A chunk as a message.

    Raises:
        CodecError: no rows, rows of another type, or not all of one sender.
    """
    return to_point_cloud(_with_ids(chunk), frame_id, stamp)


def chunk_to_cdr(chunk: RowChunk, frame_id: str, stamp: Time) -> bytes:
    """The same as the bytes of the message.

    Raises:
        CodecError: as `to_chunk_cloud`.
    """
    return rows_to_cdr(_with_ids(chunk), frame_id, stamp)


def _with_ids(chunk: RowChunk) -> Rows:
    """The rows of a chunk, each with whose it is."""
    dtype = STREAM_DTYPE.get(chunk.stream)
    if dtype is None or chunk.rows.dtype != dtype or chunk.rows.ndim != 1:
        raise CodecError(f"{chunk.rows.dtype} is not what the {chunk.stream.name} stream carries")
    for name, value in (("run_id", chunk.run_id), ("session_id", chunk.session_id)):
        if not 0 <= value <= _MAX_UINT32:
            raise CodecError(f"{name} {value} does not fit 32 bits; number them from 0")
    rows = np.empty(chunk.rows.size, dtype=chunk_dtype(chunk.stream))
    # All bytes of a row at once: field by field takes three times as long.
    _bytes(rows)[:, : dtype.itemsize] = _bytes(np.ascontiguousarray(chunk.rows))
    rows["run_id"] = chunk.run_id
    if chunk.stream in _PER_MACHINE_STREAMS:
        rows["session_id"] = chunk.session_id
    if _sender_ids(rows, chunk.stream) != (chunk.run_id, chunk.machine_id, chunk.session_id):
        raise CodecError(
            f"{chunk.stream.name} rows are said to be of machine {chunk.machine_id}, life"
            f" {chunk.session_id}, and are of another"
        )
    return rows


def from_chunk_cloud(msg: PointCloud2, stream: Stream) -> RowChunk:
    """The chunk a message of a stream's topic holds.

    Raises:
        CodecError: other fields, no rows, or not all of one sender.
    """
    return _chunk_from_rows(from_point_cloud(msg, chunk_dtype(stream)), stream)


def chunk_from_cdr(data: bytes, stream: Stream) -> RowChunk | None:
    """The chunk that a message's bytes hold; None if they are laid out otherwise (`cdr_to_rows`).

    Raises:
        CodecError: no rows, or not all of one sender.
    """
    rows = cdr_to_rows(data, chunk_dtype(stream))
    return None if rows is None else _chunk_from_rows(rows, stream)


def _chunk_from_rows(rows: Rows, stream: Stream) -> RowChunk:
    run_id, machine_id, session_id = _sender_ids(rows, stream)
    own = np.empty(rows.size, dtype=STREAM_DTYPE[stream])
    _bytes(own)[:] = _bytes(rows)[:, : own.dtype.itemsize]
    return RowChunk(run_id, stream, machine_id, session_id, own)


def _sender_ids(rows: Rows, stream: Stream) -> tuple[int, int, int]:
    """(epoch, source, life) of a chunk; source and life 0 for what is sent to all."""
    if rows.size == 0:
        raise CodecError(f"a chunk of {stream.name} has no rows, so it does not say whose it is")
    names = (
        ("run_id", "machine_id", "session_id") if stream in _PER_MACHINE_STREAMS else ("run_id",)
    )
    for name in names:
        if (rows[name] != rows[name][0]).any():
            raise CodecError(f"a chunk of {stream.name} mixes rows of more than one {name}")
    first = {name: int(rows[name][0]) for name in names}
    return first["run_id"], first.get("machine_id", 0), first.get("session_id", 0)


def _bytes(rows: Rows) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
    """The bytes of rows, shape (rows, bytes of one); a view."""
    return rows.view(np.uint8).reshape(rows.size, rows.dtype.itemsize)
