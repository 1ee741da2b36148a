"""What is still to dig and to fill, as a labelled array."""

from __future__ import annotations

import array
import math
from typing import NamedTuple

from std_msgs.msg import Float64MultiArray, MultiArrayDimension, MultiArrayLayout

from msg_bridge.codec.errors import CodecError

__all__ = ["CutFillState", "from_cut_fill_array", "to_cut_fill_array"]

_LABEL = "time_s,cut_m3,fill_m3,remaining_m3,within_tolerance"


class CutFillState(NamedTuple):
    """How far the ground is from its design.

    Attributes:
        time: simulation time it is of [s]; an array message has no stamp.
        cut, fill: room still to remove, and to add [m^3].
        remaining: both together [m^3].
        within_tolerance: part of the designed cells that are as high as they shall be, 0..1.
    """

    time: float
    cut: float
    fill: float
    remaining: float
    within_tolerance: float


def to_cut_fill_array(state: CutFillState) -> Float64MultiArray:
    """The state as one dimension of values whose label names each of them, with its unit."""
    data = array.array("d", state)
    size = len(data)
    dimension = MultiArrayDimension(label=_LABEL, size=size, stride=size)
    return Float64MultiArray(layout=MultiArrayLayout(dim=[dimension], data_offset=0), data=data)


def from_cut_fill_array(msg: Float64MultiArray) -> CutFillState:
    """The state that a message holds.

    Raises:
        CodecError: another label, other than one value for each name in it, or values that are
            negative or not finite.
    """
    size = len(CutFillState._fields)
    found = [(dim.label, dim.size, dim.stride) for dim in msg.layout.dim]
    if found != [(_LABEL, size, size)] or msg.layout.data_offset or len(msg.data) != size:
        raise CodecError(
            f"the array has {len(msg.data)} values and the dimensions {found}, offset"
            f" {msg.layout.data_offset}; cut and fill are {size} values in one dimension labelled"
            f" {_LABEL!r}, offset 0"
        )
    state = CutFillState(*msg.data)
    if not all(0.0 <= value < math.inf for value in state) or state.within_tolerance > 1.0:
        raise CodecError(
            f"the array has {list(state)}; none of them is negative or infinite,"
            " within_tolerance at most 1"
        )
    return state
