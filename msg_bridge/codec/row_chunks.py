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
from msg_bridge.codec.exchange_key import ExchangeKey
from msg_bridge.codec.point_cloud import from_point_cloud, to_point_cloud
from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.messages import STREAM_DTYPE, RowChunk, Stream
from msg_bridge.contract.rows import Rows

__all__ = ["chunk_dtype", "chunk_from_cdr", "chunk_to_cdr", "from_chunk_cloud", "to_chunk_cloud"]

_PER_MACHINE_STREAMS = (Stream.SWEEP, Stream.DEPOSIT_REQUEST, Stream.BACKLOG)

_MAX_UINT32 = 2**32 - 1


_CODE_FIELDS = [(f"code{k}", "<u4") for k in range(4)]
"""Fields of the authentication code, the same in every point."""


def _with_id_fields(stream: Stream) -> np.dtype[np.void]:
    names = ("run_id", "session_id") if stream in _PER_MACHINE_STREAMS else ("run_id",)
    return np.dtype([*STREAM_DTYPE[stream].descr, *((name, "<u4") for name in names)])


_CHUNK_DTYPE = {stream: _with_id_fields(stream) for stream in STREAM_DTYPE}
_AUTHENTICATED_DTYPE = {
    stream: np.dtype([*dtype.descr, *_CODE_FIELDS]) for stream, dtype in _CHUNK_DTYPE.items()
}


def chunk_dtype(stream: Stream, *, is_authenticated: bool = False) -> np.dtype[np.void]:
    """Return the dtype of the points of a stream: its row, `run_id`, `session_id` if it is sent by,
    or to, one machine, and an authentication code if it has one."""
    return (_AUTHENTICATED_DTYPE if is_authenticated else _CHUNK_DTYPE)[stream]


def to_chunk_cloud(
    chunk: RowChunk, frame_id: str, stamp: Time, key: ExchangeKey | None = None
) -> PointCloud2:
    """Encode a chunk as a message.

    Args:
        chunk: the rows.
        frame_id: frame of their positions.
        stamp: end of their tick.
        key: key of the code that each point ends with; None: no code.

    Raises:
        CodecError: EMPTY; DTYPE; VALUE: run or session id; SENDER_MISMATCH.
    """
    return to_point_cloud(_with_code(_with_ids(chunk), chunk.stream, key), frame_id, stamp)


def chunk_to_cdr(
    chunk: RowChunk, frame_id: str, stamp: Time, key: ExchangeKey | None = None
) -> bytes:
    """Encode a chunk as a serialised message; arguments and errors as for `to_chunk_cloud`."""
    return rows_to_cdr(_with_code(_with_ids(chunk), chunk.stream, key), frame_id, stamp)


def _with_code(rows: Rows, stream: Stream, key: ExchangeKey | None) -> Rows:
    """Return rows with the authentication code of the whole chunk, if a key is given."""
    if key is None:
        return rows
    coded = np.empty(rows.size, dtype=chunk_dtype(stream, is_authenticated=True))
    _bytes(coded)[:, : rows.dtype.itemsize] = _bytes(rows)
    code = np.array(key.code(stream.name, rows.tobytes()), dtype="<i8").view("<u4")
    for (name, _), value in zip(_CODE_FIELDS, code, strict=True):
        coded[name] = value
    return coded


def _without_code(coded: Rows, stream: Stream, key: ExchangeKey | None) -> Rows:
    """Return rows without their authentication code, which is checked if a key is given.

    Raises:
        CodecError: EMPTY or AUTHENTICATION.
    """
    rows = np.empty(coded.size, dtype=chunk_dtype(stream))
    _bytes(rows)[:] = _bytes(coded)[:, : rows.dtype.itemsize]
    if key is not None and rows.size:
        found = [int(coded[name][0]) for name, _ in _CODE_FIELDS]
        expected = np.array(key.code(stream.name, rows.tobytes()), dtype="<i8").view("<u4")
        if found != expected.tolist():
            raise _authentication_error(stream)
    return rows


def _authentication_error(stream: Stream) -> CodecError:
    return CodecError(
        f"a chunk of {stream.name} does not have the code of the exchange key; give all nodes the"
        " same exchange_key_file",
        ErrorCode.AUTHENTICATION,
    )


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


def from_chunk_cloud(msg: PointCloud2, stream: Stream, key: ExchangeKey | None = None) -> RowChunk:
    """Decode a chunk from a message on the topic of a stream.

    Args:
        msg: the message.
        stream: the stream.
        key: key of the code that each point must end with; None: a code is not checked.

    Raises:
        CodecError: EMPTY; SENDER_MISMATCH; AUTHENTICATION; or as `from_point_cloud`.
    """
    if key is None:
        return _chunk_from_rows(from_point_cloud(msg, chunk_dtype(stream)), stream)
    if not {name for name, _ in _CODE_FIELDS} <= {field.name for field in msg.fields}:
        raise _authentication_error(stream)
    coded = from_point_cloud(msg, chunk_dtype(stream, is_authenticated=True))
    return _chunk_from_rows(_without_code(coded, stream, key), stream)


def chunk_from_cdr(data: bytes, stream: Stream, key: ExchangeKey | None = None) -> RowChunk | None:
    """Decode a serialised chunk; None if its layout is not one of the usual ones (`cdr_to_rows`).

    Args:
        data: the CDR bytes.
        stream, key: as for `from_chunk_cloud`.

    Raises:
        CodecError: EMPTY, SENDER_MISMATCH or AUTHENTICATION.
    """
    if key is None:
        rows = cdr_to_rows(data, chunk_dtype(stream))
        if rows is not None:
            return _chunk_from_rows(rows, stream)
    coded = cdr_to_rows(data, chunk_dtype(stream, is_authenticated=True))
    return None if coded is None else _chunk_from_rows(_without_code(coded, stream, key), stream)


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
