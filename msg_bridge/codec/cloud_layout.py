"""Layout of a serialised PointCloud2: its fields, and where its rows are.

All clouds of one layout differ only in stamp, frame, size and rows. What describes a row, from the
number of fields up to `point_step`, is serialised or parsed once and then only compared.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np

from msg_bridge.codec.cdr_primitives import (
    STAMP,
    UINT32,
    is_little_endian,
    pack_string,
    read_string,
    string_end,
)
from msg_bridge.codec.point_cloud import point_fields

__all__ = [
    "CloudField",
    "CloudLayout",
    "PointBlock",
    "RowBlock",
    "layout_of_dtype",
    "read_cloud_layout",
]

_FRAME_ID_OFFSET = 4 + STAMP.size  # after the CDR header and the stamp
_SHAPE = struct.Struct("<II")  # height, width
_FIELD = struct.Struct("<IBxxxI")  # offset, datatype, num_values
_ROW_STEP_AND_SIZE = struct.Struct("<II")


class CloudField(NamedTuple):
    """A sensor_msgs/PointField.

    Attributes:
        name: its name.
        offset: offset in a row [bytes].
        datatype: a constant of PointField.
        num_values: `count` of the PointField.
    """

    name: str
    offset: int
    datatype: int
    num_values: int


class RowBlock(NamedTuple):
    """The rows of a message: offset in its CDR bytes, and their number."""

    offset: int
    num_rows: int


class PointBlock(NamedTuple):
    """The points of a message: offset in its CDR bytes, and height and width of the cloud."""

    offset: int
    height: int
    width: int


@dataclass(frozen=True)
class CloudLayout:
    """Layout of the rows, or points, of little-endian clouds.

    Attributes:
        fields: the fields of a row.
        step: size of a row [bytes].
    """

    fields: tuple[CloudField, ...]
    step: int

    @cached_property
    def description(self) -> bytes:
        """The CDR bytes from the number of fields up to `point_step`.

        They begin at a multiple of 4, and nothing in them has a larger alignment.
        """
        parts = [UINT32.pack(len(self.fields))]
        for name, *rest in self.fields:
            parts += [pack_string(name), _FIELD.pack(*rest)]
        return b"".join([*parts, b"\0\0\0\0", UINT32.pack(self.step)])  # is_bigendian: false

    def find_rows(self, data: bytes) -> RowBlock | None:
        """Return where the rows of a serialised message of height 1 are.

        Returns:
            None if the message has another layout or height, sizes that contradict one another, or
            is cut short.
        """
        block = self.find_points(data)
        return None if block is None or block.height != 1 else RowBlock(block.offset, block.width)

    def find_points(self, data: bytes) -> PointBlock | None:
        """Return where the points of a serialised message of any height are.

        Returns:
            None, as of `find_rows`.
        """
        expected, mask = self._pattern
        try:
            offset = string_end(data, _FRAME_ID_OFFSET)
            height, width = _SHAPE.unpack_from(data, offset)
            begin = offset + _SHAPE.size
            end = begin + len(self.description)
            description = int.from_bytes(data[begin:end], "little")
            if not is_little_endian(data) or description & mask != expected:
                return None
            row_step, size = _ROW_STEP_AND_SIZE.unpack_from(data, end)
        except struct.error:
            return None
        first = end + _ROW_STEP_AND_SIZE.size
        is_consistent = row_step == width * self.step and size == row_step * height
        if not is_consistent or len(data) <= first + size:  # is_dense follows the points
            return None
        return PointBlock(first, height, width)

    @cached_property
    def _pattern(self) -> tuple[int, int]:
        """The description as an integer, and a mask without its padding, which is undefined."""
        mask = bytearray(b"\xff" * 4)
        for field in self.fields:
            name = len(field.name.encode()) + 1
            mask += b"\xff" * (4 + name) + b"\0" * (-name % 4)
            mask += b"\xff\xff\xff\xff\xff\0\0\0\xff\xff\xff\xff"  # as _FIELD
        mask += b"\xff\0\0\0" + b"\xff" * 4  # is_bigendian, point_step
        return int.from_bytes(self.description, "little"), int.from_bytes(mask, "little")


@cache
def layout_of_dtype(dtype: np.dtype[np.void]) -> CloudLayout:
    """Return the layout of clouds of a packed little-endian dtype.

    Raises:
        CodecError: DTYPE.
    """
    fields = [CloudField(f.name, f.offset, f.datatype, f.count) for f in point_fields(dtype)]
    return CloudLayout(tuple(fields), dtype.itemsize)


def read_cloud_layout(data: bytes) -> CloudLayout | None:
    """Return the layout of a serialised PointCloud2.

    Returns:
        None if it is big-endian, has rows without size, or is malformed.
    """
    if not is_little_endian(data):
        return None
    try:
        offset = string_end(data, _FRAME_ID_OFFSET) + _SHAPE.size
        (num_fields,) = UINT32.unpack_from(data, offset)
        offset += 4
        fields = []
        for _ in range(num_fields):
            name, offset = read_string(data, offset)
            fields.append(CloudField(name, *_FIELD.unpack_from(data, offset)))
            offset += _FIELD.size
        is_big_endian = data[offset : offset + 1] != b"\0"
        (step,) = UINT32.unpack_from(data, offset + 4)
    except (struct.error, UnicodeDecodeError):
        return None
    return None if step == 0 or is_big_endian else CloudLayout(tuple(fields), step)
