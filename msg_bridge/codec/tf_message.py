"""Serialise a tf2_msgs/TFMessage from serialised TransformStamped messages, without tf2_msgs."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import NamedTuple

from msg_bridge.codec.cdr_primitives import (
    LITTLE_ENDIAN,
    STAMP,
    UINT32,
    is_little_endian,
    string_end,
)

__all__ = ["SerializedTransform", "read_transform", "tf_message_to_cdr"]

_HEADER_SIZE = len(LITTLE_ENDIAN)
_TRANSFORM = struct.Struct("<7d")
"""Translation [m] and quaternion (x, y, z, w)."""


class SerializedTransform(NamedTuple):
    """Parts of a serialised TransformStamped.

    Attributes:
        stamp: its 8 bytes.
        frames: `frame_id` and `child_frame_id`, each padded to a multiple of 4 bytes.
        transform: translation and rotation, 56 bytes, aligned to 8 bytes in a message.
    """

    stamp: bytes
    frames: bytes
    transform: bytes


def read_transform(data: bytes) -> SerializedTransform | None:
    """Return the parts of a serialised TransformStamped; None if it is not valid little-endian CDR.

    Args:
        data: CDR bytes of a geometry_msgs/TransformStamped.
    """
    try:
        frames = _HEADER_SIZE + STAMP.size
        end = string_end(data, string_end(data, frames))
    except struct.error:
        return None
    begin = end + -(end - _HEADER_SIZE) % 8
    transform = data[begin : begin + _TRANSFORM.size]
    if len(transform) != _TRANSFORM.size or not is_little_endian(data):
        return None
    return SerializedTransform(data[_HEADER_SIZE:frames], data[frames:end], transform)


def tf_message_to_cdr(transforms: Sequence[SerializedTransform]) -> bytes:
    """Serialise a TFMessage.

    Args:
        transforms: its transforms.

    Returns:
        CDR bytes, little-endian.
    """
    content = bytearray(UINT32.pack(len(transforms)))
    for each in transforms:
        content += b"\0" * (-len(content) % 4) + each.stamp + each.frames
        content += b"\0" * (-len(content) % 8) + each.transform
    return LITTLE_ENDIAN + bytes(content)
