"""Rows as PointCloud2 and back: a field is a field, a row is a point, the bytes are the same.

Sending copies the rows once, into the message. Receiving copies nothing: the rows returned are a
read-only view of the message's data, and keep it alive.
"""

from __future__ import annotations

import array
from functools import cache
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from msg_bridge.codec.errors import CodecError
from msg_bridge.contract.rows import Rows

__all__ = ["from_point_cloud", "point_fields", "to_byte_array", "to_point_cloud"]

_DATATYPES = {
    np.dtype("u1"): PointField.UINT8,
    np.dtype("<u2"): PointField.UINT16,
    np.dtype("<u4"): PointField.UINT32,
    np.dtype("<f4"): PointField.FLOAT32,
    np.dtype("<f8"): PointField.FLOAT64,
}


def to_point_cloud(rows: Rows, frame_id: str, stamp: Time, *, height: int = 1) -> PointCloud2:
    """Rows as a message.

    Args:
        rows: of a packed little-endian dtype of u1, u2, u4, f4 and f8 fields.
        frame_id: frame of the positions among the fields.
        stamp: end of the tick the rows belong to.
        height: rows of an organised cloud, over which `rows` run in row-major order.

    Raises:
        CodecError: rows that no such message can hold.
    """
    fields = point_fields(rows.dtype)
    if rows.ndim != 1 or height < 1 or rows.size % height:
        raise CodecError(f"rows of shape {rows.shape} do not fill a cloud of height {height}")
    width = rows.size // height
    return PointCloud2(
        header=Header(stamp=stamp, frame_id=frame_id),
        height=height,
        width=width,
        fields=fields,
        is_bigendian=False,
        point_step=rows.dtype.itemsize,
        row_step=width * rows.dtype.itemsize,
        data=to_byte_array(rows),
        is_dense=True,
    )


def from_point_cloud(msg: PointCloud2, dtype: np.dtype[np.void]) -> Rows:
    """The rows of a message, in row-major order if it is organised.

    Returns:
        A one-dimensional read-only view of `msg.data`, which cannot be resized while it lives.

    Raises:
        CodecError: the message does not hold exactly such rows; says what is wrong.
    """
    fields = _fields(dtype)
    if msg.is_bigendian:
        raise CodecError("the cloud is big-endian; rows are little-endian")
    _check_fields(msg, fields)
    sizes = (
        ("point_step", msg.point_step, dtype.itemsize),
        ("row_step", msg.row_step, msg.width * dtype.itemsize),
        ("data length", len(msg.data), msg.height * msg.width * dtype.itemsize),
    )
    for name, found, expected in sizes:
        if found != expected:
            raise CodecError(
                f"the cloud's {name} is {found} bytes; {msg.height} x {msg.width} of these points"
                f" make it {expected}"
            )
    rows: Rows = np.frombuffer(msg.data, dtype=dtype)
    rows.flags.writeable = False
    return rows


def to_byte_array(values: NDArray[Any]) -> array.array[int]:
    """The bytes of an array in row-major order, copied once, as a message takes them.

    Given an array.array, a message keeps it; anything else it would copy again or, if
    ROS_PYTHON_CHECK_FIELDS is set, look at byte by byte.
    """
    data = array.array("B")
    data.frombytes(np.ascontiguousarray(values).reshape(-1).view(np.uint8).data)
    return data


@cache
def _fields(dtype: np.dtype[np.void]) -> dict[str, tuple[int, int]]:
    """(offset, PointField datatype) of each field of a dtype."""
    if dtype.fields is None:
        raise CodecError(f"rows have named fields, and {dtype} has none")
    fields: dict[str, tuple[int, int]] = {}
    end = 0
    for name in dtype.names or ():
        kind, offset = dtype.fields[name][:2]
        if kind not in _DATATYPES:
            raise CodecError(f"field {name} is {kind}; rows are made of u1, <u2, <u4, <f4 and <f8")
        if offset != end:
            raise CodecError(f"field {name} is at byte {offset}, not {end}; rows have no gaps")
        fields[name] = (offset, _DATATYPES[kind])
        end += kind.itemsize
    if dtype.itemsize != end:
        raise CodecError(f"rows have {dtype.itemsize} bytes, not {end}; rows have no gaps")
    return fields


@cache
def point_fields(dtype: np.dtype[np.void]) -> list[PointField]:
    """The fields of a message of such rows; all messages of a dtype share them."""
    return [
        PointField(name=name, offset=offset, datatype=datatype, count=1)
        for name, (offset, datatype) in _fields(dtype).items()
    ]


def _check_fields(msg: PointCloud2, expected: dict[str, tuple[int, int]]) -> None:
    layout = [(field.name, (field.offset, field.datatype)) for field in msg.fields]
    if layout == list(expected.items()) and all(field.count == 1 for field in msg.fields):
        return
    found = [field.name for field in msg.fields]
    for problem, names in (
        ("lacks", [name for name in expected if name not in found]),
        ("has unknown", [name for name in found if name not in expected]),
        ("repeats", sorted({name for name in found if found.count(name) > 1})),
    ):
        if names:
            raise CodecError(
                f"the cloud {problem} {', '.join(names)}; its fields must be {', '.join(expected)}"
            )
    for field in msg.fields:
        offset, datatype = expected[field.name]
        for name, value, right in (
            ("offset", field.offset, offset),
            ("datatype", field.datatype, datatype),
            ("count", field.count, 1),
        ):
            if value != right:
                raise CodecError(
                    f"the cloud's field {field.name} has {name} {value}; it must be {right}"
                )
