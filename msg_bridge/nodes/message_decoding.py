"""Decode messages of the exchange from CDR: directly if possible, else through rclpy."""

from __future__ import annotations

from typing import Any

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Int64MultiArray

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.exchange_key import ExchangeKey
from msg_bridge.codec.row_chunks import chunk_from_cdr, from_chunk_cloud
from msg_bridge.codec.tick_headers import ArrayMessage, from_multi_array, message_from_cdr
from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.messages import RowChunk, Stream

__all__ = ["decode_array", "decode_chunk"]


def decode_array(data: bytes, key: ExchangeKey | None = None) -> ArrayMessage:
    """Decode the header, request or ledger in the CDR bytes of an Int64MultiArray.

    Args:
        data: the CDR bytes.
        key: key of its authentication code; None: a code is not checked.

    Raises:
        CodecError: the array is none of these, or does not have the code of the key.
    """
    found = message_from_cdr(data, key)
    if found is None:
        return from_multi_array(_deserialize(data, Int64MultiArray), key)
    return found


def decode_chunk(data: bytes, stream: Stream, key: ExchangeKey | None = None) -> RowChunk:
    """Decode the rows in the CDR bytes of a PointCloud2.

    Args:
        data: the CDR bytes.
        stream: the stream.
        key: key of the authentication code; None: a code is not checked.

    Raises:
        CodecError: the points are not rows of that stream, or do not have the code of the key.
    """
    found = chunk_from_cdr(data, stream, key)
    if found is None:
        return from_chunk_cloud(_deserialize(data, PointCloud2), stream, key)
    return found


def _deserialize(data: bytes, kind: Any) -> Any:
    """Deserialize a message.

    Raises:
        CodecError: SERIALIZATION.
    """
    try:
        return deserialize_message(data, kind)
    except (RuntimeError, MemoryError) as error:  # rclpy's RMWError is a RuntimeError
        raise CodecError(
            f"{len(data)} bytes are not a {kind.__name__}: they are truncated or of another type",
            ErrorCode.SERIALIZATION,
        ) from error
