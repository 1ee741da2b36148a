"""Messages of the exchange from their bytes: the quick way, or the slow one where it must be."""

from __future__ import annotations

from typing import Any

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Int64MultiArray

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.row_chunks import chunk_from_cdr, from_chunk_cloud
from msg_bridge.codec.tick_headers import ArrayMessage, from_multi_array, message_from_cdr
from msg_bridge.contract.messages import RowChunk, Stream

__all__ = ["decode_array", "decode_chunk"]


def decode_array(data: bytes) -> ArrayMessage:
    """The header, request or ledger of an Int64MultiArray's bytes.

    Raises:
        CodecError: it is none.
    """
    found = message_from_cdr(data)
    if found is None:
        return from_multi_array(_deserialize(data, Int64MultiArray))
    return found


def decode_chunk(data: bytes, stream: Stream) -> RowChunk:
    """The rows of a PointCloud2's bytes.

    Raises:
        CodecError: they are not rows of that stream.
    """
    found = chunk_from_cdr(data, stream)
    if found is None:
        return from_chunk_cloud(_deserialize(data, PointCloud2), stream)
    return found


def _deserialize(data: bytes, kind: Any) -> Any:
    """A message as an object.

    Raises:
        CodecError: its bytes are not of that kind: cut short, say.
    """
    try:
        return deserialize_message(data, kind)
    except (RuntimeError, MemoryError) as error:  # rclpy's RMWError is a RuntimeError
        raise CodecError(
            f"{len(data)} bytes are no {kind.__name__}: they are cut short or of another type"
        ) from error
