"""Arrays of named figures: one dimension whose label names each of them, with its unit."""

from __future__ import annotations

import array
from collections.abc import Sequence

from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

from msg_bridge.codec.errors import CodecError

__all__ = ["from_labelled_array", "to_labelled_array"]


def to_labelled_array(label: str, values: Sequence[float]) -> Float64MultiArray:
    """The figures as a message.

    Args:
        label: their names, with commas between.
        values: one for each.
    """
    data = array.array("d", values)
    dimension = MultiArrayDimension(label=label, size=len(data), stride=len(data))
    return Float64MultiArray(layout=MultiArrayLayout(dim=[dimension], data_offset=0), data=data)


def from_labelled_array(msg: Float64MultiArray, label: str, what: str) -> list[float]:
    """The figures that a message holds.

    Args:
        msg: the message.
        label: the names that it must have.
        what: what it should be, for the error.

    Raises:
        CodecError: another label, or other than one value for each name in it.
    """
    size = label.count(",") + 1
    found = [(dim.label, dim.size, dim.stride) for dim in msg.layout.dim]
    if found != [(label, size, size)] or msg.layout.data_offset or len(msg.data) != size:
        raise CodecError(
            f"the array has {len(msg.data)} values and the dimensions {found}, offset"
            f" {msg.layout.data_offset}; {what} {size} values in one dimension labelled {label!r},"
            " offset 0"
        )
    return list(msg.data)
