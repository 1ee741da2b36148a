"""Rows as PointCloud2 and back: each field of a row is a field of a point, byte for byte.

Encoding copies the rows once, into the message. Decoding copies nothing: the rows returned are a
read-only view of the message's data and keep it alive.
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
from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.rows import Rows

__all__ = [
    "allocate_point_cloud",
    "from_point_cloud",
    "point_fields",
    "to_byte_array",
    "to_point_cloud",
]

_DATATYPES = {
    np.dtype("u1"): PointField.UINT8,
    np.dtype("<u2"): PointField.UINT16,
    np.dtype("<u4"): PointField.UINT32,
    np.dtype("<f4"): PointField.FLOAT32,
    np.dtype("<f8"): PointField.FLOAT64,
}


def to_point_cloud(rows: Rows, frame_id: str, stamp: Time, *, height: int = 1) -> PointCloud2:
    """Encode rows as a message.

    Args:
        rows: shape (height * width,), of a packed little-endian dtype of u1, u2, u4, f4 and f8
            fields.
        frame_id: coordinate frame of the positions among the fields.
        stamp: end of the tick that the rows belong to.
        height: number of rows of an organised cloud, which `rows` fill in row-major order.

    Raises:
        CodecError: DTYPE or SHAPE.
    """
    if rows.ndim != 1:
        raise CodecError(f"rows have shape {rows.shape}; give one dimension", ErrorCode.SHAPE)
    msg, points = allocate_point_cloud(rows.size, rows.dtype, frame_id, stamp, height=height)
    points[:] = rows
    return msg


def allocate_point_cloud(
    count: int, dtype: np.dtype[np.void], frame_id: str, stamp: Time, *, height: int = 1
) -> tuple[PointCloud2, Rows]:
    """Return a message of zeros, and its rows, to be written.

    For large clouds: an array that is given to a message is copied, once or twice.

    Args:
        count: number of rows.
        dtype: that of the rows, as for `to_point_cloud`.
        frame_id, stamp, height: as for `to_point_cloud`.

    Raises:
        CodecError: DTYPE or SHAPE.
    """
    fields = point_fields(dtype)
    if height < 1 or count % height:
        raise CodecError(f"{count} rows do not fill a cloud of height {height}", ErrorCode.SHAPE)
    width = count // height
    msg = PointCloud2(
        header=Header(stamp=stamp, frame_id=frame_id),
        height=height,
        width=width,
        fields=fields,
        is_bigendian=False,
        point_step=dtype.itemsize,
        row_step=width * dtype.itemsize,
        is_dense=True,
    )
    data = msg.data
    data.append(0)
    data *= count * dtype.itemsize
    return msg, np.frombuffer(data, dtype=dtype)


def from_point_cloud(msg: PointCloud2, dtype: np.dtype[np.void]) -> Rows:
    """Decode the rows of a message, in row-major order if the cloud is organised.

    Fields that are not of `dtype` are left out if they lie behind those that are: a later version
    may append fields.

    Returns:
        A read-only array, shape (height * width,): a view of `msg.data`, which cannot be resized
        while the view lives, or a copy if points have further fields.

    Raises:
        CodecError: BYTE_ORDER, FIELDS or LAYOUT.
    """
    fields = _fields(dtype)
    if msg.is_bigendian:
        raise CodecError(
            "the cloud is big-endian; send it in little-endian order", ErrorCode.BYTE_ORDER
        )
    _check_fields(msg, fields, dtype.itemsize)
    _check_sizes(msg, dtype)
    step = msg.point_step
    if step == dtype.itemsize:
        rows: Rows = np.frombuffer(msg.data, dtype=dtype)
    else:
        points = np.frombuffer(msg.data, dtype=np.uint8).reshape(-1, step)
        rows = np.ascontiguousarray(points[:, : dtype.itemsize]).reshape(-1).view(dtype)
    rows.flags.writeable = False
    return rows


def to_byte_array(values: NDArray[Any]) -> array.array[int]:
    """Return the bytes of an array in row-major order, copied once.

    For a field of a message: other sequences are checked byte by byte if ROS_PYTHON_CHECK_FIELDS is
    set.
    """
    data = array.array("B")
    data.frombytes(np.ascontiguousarray(values).reshape(-1).view(np.uint8).data)
    return data


@cache
def _fields(dtype: np.dtype[np.void]) -> dict[str, tuple[int, int]]:
    """Return (offset, PointField datatype) of each field of a dtype, by name.

    Raises:
        CodecError: DTYPE.
    """
    if dtype.fields is None:
        raise CodecError(f"{dtype} has no named fields; give a structured dtype", ErrorCode.DTYPE)
    fields: dict[str, tuple[int, int]] = {}
    end = 0
    for name in dtype.names or ():
        kind, offset = dtype.fields[name][:2]
        if kind not in _DATATYPES:
            raise CodecError(
                f"field {name} is {kind}; give u1, <u2, <u4, <f4 or <f8", ErrorCode.DTYPE
            )
        if offset != end:
            raise CodecError(
                f"field {name} is at byte {offset}, not {end}; give a packed dtype",
                ErrorCode.DTYPE,
            )
        fields[name] = (offset, _DATATYPES[kind])
        end += kind.itemsize
    if dtype.itemsize != end:
        raise CodecError(
            f"rows have {dtype.itemsize} bytes, not {end}; give a packed dtype", ErrorCode.DTYPE
        )
    return fields


@cache
def point_fields(dtype: np.dtype[np.void]) -> list[PointField]:
    """Return the fields of a message of such rows; all messages of a dtype share the list."""
    return [
        PointField(name=name, offset=offset, datatype=datatype, count=1)
        for name, (offset, datatype) in _fields(dtype).items()
    ]


def _check_fields(msg: PointCloud2, expected: dict[str, tuple[int, int]], size: int) -> None:
    """Check that known fields have their layout, and that no other field overlaps them.

    Raises:
        CodecError: FIELDS.
    """
    names = [field.name for field in msg.fields]
    missing = [name for name in expected if name not in names]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if missing or repeated:
        raise CodecError(
            f"the cloud lacks the fields [{', '.join(missing)}] and repeats"
            f" [{', '.join(repeated)}]; its fields must be {', '.join(expected)}",
            ErrorCode.FIELDS,
        )
    for field in msg.fields:
        layout = (field.offset, field.datatype)
        if field.name in expected:
            is_valid = layout == expected[field.name] and field.count == 1
        else:
            is_valid = field.offset >= size
        if not is_valid:
            right = expected.get(field.name, f"behind byte {size}")
            raise CodecError(
                f"the cloud's field {field.name} has offset and datatype {layout} and count"
                f" {field.count}; give {right} and count 1",
                ErrorCode.FIELDS,
            )


def _check_sizes(msg: PointCloud2, dtype: np.dtype[np.void]) -> None:
    """Check that the sizes of a cloud agree.

    Raises:
        CodecError: LAYOUT.
    """
    step = max(msg.point_step, dtype.itemsize)
    for name, found, expected in (
        ("point_step", msg.point_step, step),
        ("row_step", msg.row_step, msg.width * step),
        ("data length", len(msg.data), msg.height * msg.width * step),
    ):
        if found != expected:
            raise CodecError(
                f"the cloud's {name} is {found} bytes; {msg.height} x {msg.width} of these points"
                f" need {expected}",
                ErrorCode.LAYOUT,
            )
