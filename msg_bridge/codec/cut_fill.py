"""What is still to dig and to fill, as a labelled array."""

from __future__ import annotations

import math
from typing import NamedTuple

from std_msgs.msg import Float64MultiArray

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.labelled_array import from_labelled_array, to_labelled_array

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
    return to_labelled_array(_LABEL, state)


def from_cut_fill_array(msg: Float64MultiArray) -> CutFillState:
    """The state that a message holds.

    Raises:
        CodecError: another label, other than one value for each name in it, or values that are
            negative or not finite.
    """
    state = CutFillState(*from_labelled_array(msg, _LABEL, "cut and fill are"))
    if not all(0.0 <= value < math.inf for value in state) or state.within_tolerance > 1.0:
        raise CodecError(
            f"the array has {list(state)}; none of them is negative or infinite,"
            " within_tolerance at most 1"
        )
    return state
