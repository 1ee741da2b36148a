"""Row clouds and number arrays straight to the bytes that cross the wire, and back.

A PointCloud2 or Int64MultiArray as a Python object costs several times what its content does: every
field of a point is an object of its own, made and converted at both ends, for every message. All
row clouds of one type differ in stamp, size and data alone; the rest is made once. The bytes are
those of rclpy's own serialisation (CDR, little-endian, as ROS 2 sends it), which a test compares.
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
from msg_bridge.contract.rows import Rows

__all__ = ["array_to_cdr", "cdr_to_array", "cdr_to_rows", "rows_to_cdr"]

_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
_STAMP = struct.Struct("<iI")
_TWO = struct.Struct("<II")
_THREE = struct.Struct("<III")
_ONE = struct.Struct("<I")


def rows_to_cdr(rows: Rows, frame_id: str, stamp: Time) -> bytes:
    """Rows as the bytes of the PointCloud2 that `to_point_cloud` makes of them.

    Args:
        rows: of a packed little-endian dtype, shape (n,).
        frame_id: frame of the positions among the fields.
        stamp: end of the tick the rows belong to.

    Raises:
        CodecError: rows that no such message can hold.
    """
    if rows.ndim != 1:
        raise CodecError(f"rows of shape {rows.shape} are no row of points")
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
    """The rows of a message, a read-only view of its bytes; None if it is laid out otherwise.

    It may then still be a cloud of such rows, from a sender that orders its fields or bytes
    differently: `from_point_cloud` says what is wrong with it, if anything is.
    """
    fields, expected, mask = _description(dtype)
    try:
        (length,) = _ONE.unpack_from(data, 12)
        at = 16 + length + -length % 4
        height, width = _TWO.unpack_from(data, at)
        at += 8
        described = int.from_bytes(data[at : at + len(fields)], "little")
        if data[:4] != _LITTLE_ENDIAN or described & mask != expected:
            return None
        at += len(fields)
        step, row_step, size = _THREE.unpack_from(data, at)
    except struct.error:
        return None
    at += 12
    whole = width * dtype.itemsize
    if height != 1 or step != dtype.itemsize or row_step != whole or size != whole:
        return None
    if len(data) < at + size + 1:
        return None
    rows: Rows = np.frombuffer(data, dtype=dtype, count=width, offset=at)
    return rows


def array_to_cdr(label: str, values: array.array[int]) -> bytes:
    """The bytes of an Int64MultiArray of one dimension with a label.

    Args:
        label: of the dimension.
        values: int64, typecode q.
    """
    size = len(values)
    head = _array_head(label)
    body = head + _TWO.pack(size, size) + _TWO.pack(0, size)
    return _LITTLE_ENDIAN + body + b"\0" * (-len(body) % 8) + values.tobytes()


def cdr_to_array(data: bytes) -> Int64MultiArray | None:
    """What an Int64MultiArray of one dimension holds, as an object with its attributes.

    None if it is laid out otherwise.
    """
    try:
        count, length = _TWO.unpack_from(data, 4)
        if data[:4] != _LITTLE_ENDIAN or count != 1:
            return None
        label = data[12 : 12 + length - 1].decode()
        at = 12 + length + -length % 4
        size, stride, offset = _THREE.unpack_from(data, at)
        (number,) = _ONE.unpack_from(data, at + 12)
    except (struct.error, UnicodeDecodeError):
        return None
    at += 16
    at += -(at - 4) % 8
    values = array.array("q")
    if len(data) < at + 8 * number:
        return None
    values.frombytes(data[at : at + 8 * number])
    dimension = SimpleNamespace(label=label, size=size, stride=stride)
    found: Any = SimpleNamespace(
        layout=SimpleNamespace(dim=[dimension], data_offset=offset), data=values
    )
    return found


@cache
def _frame(frame_id: str) -> bytes:
    text = frame_id.encode() + b"\0"
    return _ONE.pack(len(text)) + text + b"\0" * (-len(text) % 4)


@cache
def _description(dtype: np.dtype[np.void]) -> tuple[bytes, int, int]:
    """What says what a point is, from the number of its fields to before point_step.

    It begins at a multiple of 4, and nothing in it is aligned to more.

    Returns:
        (its bytes, the same as a number, the bits of that number that count: padding may be
        anything).
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
    """One dimension and its label."""
    text = label.encode() + b"\0"
    return _TWO.pack(1, len(text)) + text + b"\0" * (-len(text) % 4)
