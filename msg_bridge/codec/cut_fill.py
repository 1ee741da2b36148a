"""Volume still to cut and to fill, as a labelled array."""

from __future__ import annotations

import math
from typing import NamedTuple

from std_msgs.msg import Float64MultiArray

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.labelled_array import from_labelled_array, to_labelled_array
from msg_bridge.contract.errors import ErrorCode

__all__ = ["CutFillState", "from_cut_fill_array", "to_cut_fill_array"]

_LABEL = "time_s,cut_m3,fill_m3,remaining_m3,within_tolerance"


class CutFillState(NamedTuple):
    """Difference between the ground and its design.

    Attributes:
        time: simulation time of the state [s]; an array message has no stamp.
        cut: volume still to remove [m^3].
        fill: volume still to add [m^3].
        remaining: sum of both [m^3].
        within_tolerance: fraction of the designed cells whose height is within tolerance, 0..1.
    """

    time: float
    cut: float
    fill: float
    remaining: float
    within_tolerance: float


def to_cut_fill_array(state: CutFillState) -> Float64MultiArray:
    """Encode the state; the label names each value with its unit."""
    return to_labelled_array(_LABEL, state)


def from_cut_fill_array(msg: Float64MultiArray) -> CutFillState:
    """Decode the state.

    Raises:
        CodecError: LAYOUT; LABELS; VALUE: negative or not finite.
    """
    state = CutFillState(*from_labelled_array(msg, _LABEL, "cut and fill"))
    if not all(0.0 <= value < math.inf for value in state) or state.within_tolerance > 1.0:
        raise CodecError(
            f"the array has {list(state)}; give finite values from 0, and within_tolerance up to 1",
            ErrorCode.VALUE,
        )
    return state
