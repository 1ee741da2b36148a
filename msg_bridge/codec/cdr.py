"""Serialise row clouds and arrays of int64 without message objects, and parse them.

A PointCloud2 as a Python object costs several times as much as its content: each field description
is an object that is created and converted for every message at both ends. Here the fields of a
dtype are serialised once (`cloud_layout`). The bytes are those of rclpy's serialisation (CDR,
little-endian, as ROS 2 sends it), which a test compares.
"""

from __future__ import annotations

import array
import struct
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from std_msgs.msg import Int64MultiArray

from msg_bridge.codec.cdr_primitives import (
    LITTLE_ENDIAN,
    STAMP,
    UINT32,
    is_little_endian,
    pack_string,
    read_string,
)
from msg_bridge.codec.cloud_layout import layout_of_dtype
from msg_bridge.codec.errors import CodecError
from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.rows import Rows

__all__ = ["array_to_cdr", "cdr_to_array", "cdr_to_rows", "rows_to_cdr"]

_TWO = struct.Struct("<II")
_FOUR = struct.Struct("<IIII")


def rows_to_cdr(rows: Rows, frame_id: str, stamp: Time, *, height: int = 1) -> bytes:
    """Serialise rows as the PointCloud2 of `to_point_cloud`.

    Args:
        rows: shape (n,), of a packed little-endian dtype.
        frame_id: coordinate frame of the positions among the fields.
        stamp: end of the tick that the rows belong to.
        height: number of rows of an organised cloud, which `rows` fill in row-major order.

    Raises:
        CodecError: SHAPE or DTYPE.
    """
    if rows.ndim != 1:
        raise CodecError(f"rows have shape {rows.shape}; give one dimension", ErrorCode.SHAPE)
    if height < 1 or rows.size % height:
        raise CodecError(
            f"{rows.size} rows do not fill a cloud of height {height}", ErrorCode.SHAPE
        )
    layout = layout_of_dtype(rows.dtype)
    size, width = rows.size * layout.step, rows.size // height
    return b"".join(
        (
            LITTLE_ENDIAN,
            STAMP.pack(stamp.sec, stamp.nanosec),
            _frame(frame_id),
            _TWO.pack(height, width),
            layout.description,
            _TWO.pack(width * layout.step, size),
            np.ascontiguousarray(rows).tobytes(),
            b"\x01",
        )
    )


def cdr_to_rows(data: bytes, dtype: np.dtype[np.void]) -> Rows | None:
    """Return the rows of a serialised PointCloud2 as a read-only view of its bytes.

    Returns:
        None if the layout is not that of `rows_to_cdr`. The message may still be valid, as one with
        further fields is; deserialise it and call `from_point_cloud`.
    """
    block = layout_of_dtype(dtype).find_rows(data)
    if block is None:
        return None
    rows: Rows = np.frombuffer(data, dtype=dtype, count=block.num_rows, offset=block.offset)
    return rows


def array_to_cdr(label: str, values: array.array[int]) -> bytes:
    """Serialise an Int64MultiArray of one dimension.

    Args:
        label: label of the dimension.
        values: the values, typecode q.
    """
    size = len(values)
    head = _array_head(label)
    body = head + _TWO.pack(size, size) + _TWO.pack(0, size)
    return LITTLE_ENDIAN + body + b"\0" * (-len(body) % 8) + values.tobytes()


def cdr_to_array(data: bytes) -> Int64MultiArray | None:
    """Parse a serialised Int64MultiArray of one dimension into an object with its attributes.

    Returns:
        None if it has another number of dimensions, another byte order, or is cut short.
    """
    try:
        (num_dimensions,) = UINT32.unpack_from(data, 4)
        if not is_little_endian(data) or num_dimensions != 1:
            return None
        label, begin = read_string(data, 8)
        size, stride, data_offset, num_values = _FOUR.unpack_from(data, begin)
    except (struct.error, UnicodeDecodeError):
        return None
    begin += 16
    begin += -(begin - 4) % 8
    values = array.array("q")
    if len(data) < begin + 8 * num_values:
        return None
    values.frombytes(data[begin : begin + 8 * num_values])
    dimension = SimpleNamespace(label=label, size=size, stride=stride)
    message: Any = SimpleNamespace(
        layout=SimpleNamespace(dim=[dimension], data_offset=data_offset), data=values
    )
    return message


@cache
def _frame(frame_id: str) -> bytes:
    return pack_string(frame_id)


@cache
def _array_head(label: str) -> bytes:
    """Return the serialised number of dimensions, 1, and the label."""
    return UINT32.pack(1) + pack_string(label)
