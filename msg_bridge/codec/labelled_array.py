"""Arrays of named values: one dimension whose label names each value, with its unit.

A label is the names joined by commas, so that the message alone states what each number is.
Readers accept unknown names behind the known ones: a later version may append values. A
known name that is missing, repeated or in another place is an error.
"""

from __future__ import annotations

import array
from collections.abc import Sequence
from typing import Any

from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

from msg_bridge.codec.errors import CodecError
from msg_bridge.contract.errors import ErrorCode

__all__ = ["array_label", "from_labelled_array", "to_labelled_array"]


def to_labelled_array(label: str, values: Sequence[float]) -> Float64MultiArray:
    """Encode named values.

    Args:
        label: names of the values, joined by commas.
        values: one value for each name.
    """
    data = array.array("d", values)
    dimension = MultiArrayDimension(label=label, size=len(data), stride=len(data))
    return Float64MultiArray(layout=MultiArrayLayout(dim=[dimension], data_offset=0), data=data)


def from_labelled_array(msg: Float64MultiArray, label: str, content: str) -> list[float]:
    """Decode named values; values of unknown names behind the known ones are left out.

    Args:
        msg: the message.
        label: the known names, joined by commas.
        content: what the message should contain, for the error message.

    Raises:
        CodecError: LAYOUT or LABELS.
    """
    found = array_label(msg)
    if found != label and not found.startswith(f"{label},"):
        raise CodecError(
            f"the array is labelled {found!r}; the label of {content} begins with {label!r}",
            ErrorCode.LABELS,
        )
    return list(msg.data[: label.count(",") + 1])


def array_label(msg: Any) -> str:
    """Return the label of a Float64MultiArray or Int64MultiArray of one dimension.

    Raises:
        CodecError: LAYOUT: not exactly one dimension, of one value for each name of its label.
    """
    size = len(msg.data)
    dims = [(dim.size, dim.stride) for dim in msg.layout.dim]
    if dims != [(size, size)] or msg.layout.data_offset:
        raise CodecError(
            f"the array has {size} values, the dimensions {dims} (size, stride) and the offset"
            f" {msg.layout.data_offset}; give one dimension of that size and stride, offset 0",
            ErrorCode.LAYOUT,
        )
    label = str(msg.layout.dim[0].label)
    if label.count(",") + 1 != size:
        raise CodecError(
            f"the array has {size} values and the label {label!r}; give one name for each value",
            ErrorCode.LAYOUT,
        )
    return label
