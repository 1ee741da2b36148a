"""Messages with the code of an exchange key: forged, changed and uncoded ones are rejected."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Int64MultiArray, String
from support.wire import raises, random_rows

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.exchange_key import ExchangeKey
from msg_bridge.codec.row_chunks import chunk_to_cdr
from msg_bridge.codec.tick_headers import (
    from_join_rejected_string,
    message_to_cdr,
    to_join_rejected_string,
)
from msg_bridge.contract.errors import ErrorCode, ParameterError
from msg_bridge.contract.messages import (
    STREAM_DTYPE,
    JoinRejected,
    MachineHeader,
    MachineReceipt,
    RowChunk,
    RowRange,
    SoilHeader,
    Stream,
    Verb,
)
from msg_bridge.nodes.message_decoding import decode_array, decode_chunk

KEY, OTHER = ExchangeKey(b"k" * 32), ExchangeKey(b"o" * 32)
HEADERS = [
    MachineHeader(1, 2, 3, 4, Verb.STEP, RowRange(5, 6, 7), RowRange(7, 8, -9), 9, 11, 12, 3),
    SoilHeader(1, 5, 9, *(RowRange(1, 2, 3),) * 3, (MachineReceipt(2, 3, 4, 5, 6, 7),) * 2),
]


def chunk(stream: Stream, count: int = 3) -> RowChunk:
    rows = random_rows(STREAM_DTYPE[stream], count)
    if stream in (Stream.SWEEP, Stream.DEPOSIT_REQUEST, Stream.BACKLOG):
        rows["machine_id"] = 2
        return RowChunk(7, stream, 2, 9, rows)
    return RowChunk(7, stream, 0, 0, rows)


def reserialized(data: bytes, kind: type) -> bytes:
    """Return a message in a layout that is parsed by rclpy: with an appended label or field."""
    message = deserialize_message(data, kind)
    return bytes(serialize_message(message))


@pytest.mark.parametrize("header", HEADERS)
def test_header_with_the_code_is_accepted(header: MachineHeader | SoilHeader) -> None:
    data = message_to_cdr(header, KEY)
    assert decode_array(data, KEY) == header
    assert decode_array(reserialized(data, Int64MultiArray), KEY) == header
    assert decode_array(data) == header, "an observer without the key can read it"


@pytest.mark.parametrize("stream", STREAM_DTYPE)
def test_chunk_with_the_code_is_accepted(stream: Stream) -> None:
    sent = chunk(stream)
    data = chunk_to_cdr(sent, "map", Time(sec=1), KEY)
    for received in (
        decode_chunk(data, stream, KEY),
        decode_chunk(reserialized(data, PointCloud2), stream, KEY),
        decode_chunk(data, stream),
    ):
        assert received.rows.tobytes() == sent.rows.tobytes()
        assert (received.run_id, received.session_id) == (sent.run_id, sent.session_id)


@pytest.mark.parametrize("key", [None, OTHER])
def test_message_with_another_code_or_none_is_rejected(key: ExchangeKey | None) -> None:
    with raises(ErrorCode.AUTHENTICATION, CodecError):
        decode_array(message_to_cdr(HEADERS[0], key), KEY)
    with raises(ErrorCode.AUTHENTICATION, CodecError):
        decode_chunk(chunk_to_cdr(chunk(Stream.SWEEP), "map", Time(), key), Stream.SWEEP, KEY)
    rejection = JoinRejected(1, 2, 3, "full")
    with pytest.raises(CodecError):
        from_join_rejected_string(to_join_rejected_string(rejection, key), KEY)


def test_every_changed_value_of_a_header_is_noticed() -> None:
    message = deserialize_message(message_to_cdr(HEADERS[0], KEY), Int64MultiArray)
    for k in range(1, len(message.data)):
        changed = list(message.data)
        changed[k] ^= 1
        forged = deserialize_message(message_to_cdr(HEADERS[0], KEY), Int64MultiArray)
        forged.data = changed
        with pytest.raises(CodecError):
            decode_array(bytes(serialize_message(forged)), KEY)


def test_every_changed_row_is_noticed() -> None:
    data = chunk_to_cdr(chunk(Stream.CONVERSION), "map", Time(), KEY)
    cloud = deserialize_message(data, PointCloud2)
    content = bytes(cloud.data)
    for k in range(cloud.point_step - 16):  # of the last point, without its code
        forged = bytearray(content)
        forged[2 * cloud.point_step + k] ^= 1
        cloud.data = bytes(forged)
        with pytest.raises(CodecError):
            decode_chunk(bytes(serialize_message(cloud)), Stream.CONVERSION, KEY)


def test_rejection_with_the_code_is_accepted() -> None:
    rejection = JoinRejected(1, 2, 3, "machine 2 is not expected")
    assert from_join_rejected_string(to_join_rejected_string(rejection, KEY), KEY) == rejection
    text = to_join_rejected_string(rejection, KEY).data.replace("not ", "")
    with raises(ErrorCode.AUTHENTICATION, CodecError):
        from_join_rejected_string(String(data=text), KEY)


def key_file(path: Path, content: bytes, mode: int = 0o600) -> str:
    path.write_bytes(content)
    path.chmod(mode)
    return str(path)


def test_key_file_is_read(tmp_path: Path) -> None:
    content = os.urandom(32)
    key = ExchangeKey.read(key_file(tmp_path / "key", content))
    assert key is not None
    assert key.code("a", b"b") == ExchangeKey(content).code("a", b"b")
    assert ExchangeKey.read("") is None


@pytest.mark.parametrize(
    "make",
    [
        lambda folder: str(folder / "missing"),
        lambda folder: str(folder),
        lambda folder: key_file(folder / "key", b"short"),
        lambda folder: key_file(folder / "key", b"k" * 5000),
        lambda folder: key_file(folder / "key", b"k" * 32, 0o644),
    ],
)
def test_invalid_key_file_is_an_error(tmp_path: Path, make: Callable[[Path], str]) -> None:
    with pytest.raises(ParameterError):
        ExchangeKey.read(make(tmp_path))


def test_code_has_128_bits_that_depend_on_the_key() -> None:
    codes = np.array([KEY.code("a", bytes([k])) for k in range(64)])
    assert len({tuple(code) for code in codes.tolist()}) == 64
    assert KEY.code("a", b"") != OTHER.code("a", b"")
    assert KEY.code("a", b"b") != KEY.code("b", b"b")
