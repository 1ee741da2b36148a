"""Cut and fill cross as labelled values, and other arrays are refused."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Float64MultiArray

from msg_bridge.codec.cut_fill import CutFillState, from_cut_fill_array, to_cut_fill_array
from msg_bridge.codec.errors import CodecError

STATE = CutFillState(time=1.25, cut=2.5, fill=0.1, remaining=2.6, within_tolerance=0.875)


def crossed(msg: Float64MultiArray) -> Float64MultiArray:
    return deserialize_message(serialize_message(msg), Float64MultiArray)


def test_cut_and_fill_cross_bit_by_bit() -> None:
    assert from_cut_fill_array(crossed(to_cut_fill_array(STATE))) == STATE


def test_the_label_names_each_value_with_its_unit() -> None:
    (dimension,) = to_cut_fill_array(STATE).layout.dim
    assert dimension.label == "time_s,cut_m3,fill_m3,remaining_m3,within_tolerance"
    assert dimension.size == dimension.stride == 5


def other_label(msg: Float64MultiArray) -> None:
    msg.layout.dim[0].label = "cut,fill"


def no_dimension(msg: Float64MultiArray) -> None:
    msg.layout.dim = []


def shifted(msg: Float64MultiArray) -> None:
    msg.layout.data_offset = 1


def too_short(msg: Float64MultiArray) -> None:
    msg.data = msg.data[:4]


@pytest.mark.parametrize("spoil", [other_label, no_dimension, shifted, too_short])
def test_another_array_is_refused(spoil: Callable[[Float64MultiArray], None]) -> None:
    msg = to_cut_fill_array(STATE)
    spoil(msg)
    with pytest.raises(CodecError, match="in one dimension labelled 'time_s,cut_m3"):
        from_cut_fill_array(msg)


@pytest.mark.parametrize(
    "state",
    [
        STATE._replace(cut=-1.0),
        STATE._replace(fill=math.nan),
        STATE._replace(time=math.inf),
        STATE._replace(within_tolerance=1.5),
    ],
)
def test_values_that_no_ground_has_are_refused(state: CutFillState) -> None:
    with pytest.raises(CodecError, match="none of them is negative or infinite"):
        from_cut_fill_array(to_cut_fill_array(state))
