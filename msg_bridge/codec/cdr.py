"""Serialise row clouds and arrays of int64 without message objects, and parse them.

A PointCloud2 as a Python object costs several times as much as its content: each field description
is an object that is created and converted for every message at both ends. All row clouds of one
dtype differ only in stamp, size and data; the rest is serialised once. The bytes are those of
rclpy's serialisation (CDR, little-endian, as ROS 2 sends it), which a test compares.
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

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.point_cloud import point_fields
from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.rows import Rows

__all__ = ["array_to_cdr", "cdr_to_array", "cdr_to_rows", "rows_to_cdr"]

_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_STAMP = struct.Struct("<iI")
_TWO = struct.Struct("<II")
_THREE = struct.Struct("<III")
_ONE = struct.Struct("<I")


def rows_to_cdr(rows: Rows, frame_id: str, stamp: Time) -> bytes:
    """Serialise rows as the PointCloud2 of `to_point_cloud`.

    Args:
        rows: shape (n,), of a packed little-endian dtype.
        frame_id: coordinate frame of the positions among the fields.
        stamp: end of the tick that the rows belong to.

    Raises:
        CodecError: SHAPE or DTYPE.
    """
    if rows.ndim != 1:
        raise CodecError(f"rows have shape {rows.shape}; give one dimension", ErrorCode.SHAPE)
    frame, fields = _frame(frame_id), _description(rows.dtype)[0]
    step = rows.dtype.itemsize
    size = rows.size * step
    return b"".join(
        (
            _LITTLE_ENDIAN,
            _STAMP.pack(stamp.sec, stamp.nanosec),
            frame,
            _TWO.pack(1, rows.size),
            fields,
            _THREE.pack(step, size, size),
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
    fields, expected, mask = _description(dtype)
    try:
        (length,) = _ONE.unpack_from(data, 12)
        offset = 16 + length + -length % 4
        height, width = _TWO.unpack_from(data, offset)
        offset += 8
        description = int.from_bytes(data[offset : offset + len(fields)], "little")
        if data[:4] != _LITTLE_ENDIAN or description & mask != expected:
            return None
        offset += len(fields)
        step, row_step, size = _THREE.unpack_from(data, offset)
    except struct.error:
        return None
    offset += 12
    row_size = width * dtype.itemsize
    if height != 1 or step != dtype.itemsize or row_step != row_size or size != row_size:
        return None
    if len(data) < offset + size + 1:
        return None
    rows: Rows = np.frombuffer(data, dtype=dtype, count=width, offset=offset)
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
    return _LITTLE_ENDIAN + body + b"\0" * (-len(body) % 8) + values.tobytes()


def cdr_to_array(data: bytes) -> Int64MultiArray | None:
    """Parse a serialised Int64MultiArray of one dimension into an object with its attributes.

    Returns:
        None if it has another number of dimensions, another byte order, or is cut short.
    """
    try:
        count, length = _TWO.unpack_from(data, 4)
        if data[:4] != _LITTLE_ENDIAN or count != 1:
            return None
        label = data[12 : 12 + length - 1].decode()
        begin = 12 + length + -length % 4
        size, stride, data_offset = _THREE.unpack_from(data, begin)
        (num_values,) = _ONE.unpack_from(data, begin + 12)
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
    text = frame_id.encode() + b"\0"
    return _ONE.pack(len(text)) + text + b"\0" * (-len(text) % 4)


@cache
def _description(dtype: np.dtype[np.void]) -> tuple[bytes, int, int]:
    """Return the serialised description of a point: from the number of fields up to point_step.

    It begins at a multiple of 4, and nothing in it has a larger alignment.

    Returns:
        (the bytes, the same as an integer, a mask of the bits without padding, whose content is
        undefined).
    """
    out, mask = bytearray(), bytearray()

    def add(part: bytes, padding: int = 0) -> None:
        out.extend(part + b"\0" * padding)
        mask.extend(b"\xff" * len(part) + b"\0" * padding)

    fields = point_fields(dtype)
    add(_ONE.pack(len(fields)))
    for field in fields:
        name = field.name.encode() + b"\0"
        add(_ONE.pack(len(name)) + name, -len(name) % 4)
        add(_ONE.pack(field.offset))
        add(bytes((field.datatype,)), 3)
        add(_ONE.pack(field.count))
    add(b"\0", 3)  # is_bigendian: false
    return bytes(out), int.from_bytes(out, "little"), int.from_bytes(mask, "little")


@cache
def _array_head(label: str) -> bytes:
    """Return the serialised number of dimensions, 1, and the label."""
    text = label.encode() + b"\0"
    return _TWO.pack(1, len(text)) + text + b"\0" * (-len(text) % 4)
