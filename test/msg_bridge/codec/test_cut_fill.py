"""Cut and fill are transmitted as labelled values; malformed arrays are rejected."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from std_msgs.msg import Float64MultiArray
from support.wire import over_the_wire, raises

from msg_bridge.codec.cut_fill import CutFillState, from_cut_fill_array, to_cut_fill_array
from msg_bridge.codec.errors import CodecError
from msg_bridge.contract.errors import ErrorCode

STATE = CutFillState(time=1.25, cut=2.5, fill=0.1, remaining=2.6, within_tolerance=0.875)


def test_cut_and_fill_are_transmitted_bit_by_bit() -> None:
    assert from_cut_fill_array(over_the_wire(to_cut_fill_array(STATE))) == STATE


def test_label_names_each_value_with_its_unit() -> None:
    (dimension,) = to_cut_fill_array(STATE).layout.dim
    assert dimension.label == "time_s,cut_m3,fill_m3,remaining_m3,within_tolerance"
    assert dimension.size == dimension.stride == 5


def other_label(msg: Float64MultiArray) -> None:
    msg.layout.dim[0].label = "cut,fill,a,b,c"


def no_dimension(msg: Float64MultiArray) -> None:
    msg.layout.dim = []


def shifted(msg: Float64MultiArray) -> None:
    msg.layout.data_offset = 1


def too_short(msg: Float64MultiArray) -> None:
    msg.data = msg.data[:4]


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (other_label, ErrorCode.LABELS),
        (no_dimension, ErrorCode.LAYOUT),
        (shifted, ErrorCode.LAYOUT),
        (too_short, ErrorCode.LAYOUT),
    ],
)
def test_malformed_array_is_rejected(
    change: Callable[[Float64MultiArray], None], code: ErrorCode
) -> None:
    msg = to_cut_fill_array(STATE)
    change(msg)
    with raises(code, CodecError):
        from_cut_fill_array(msg)


def test_values_appended_by_a_later_version_are_left_out() -> None:
    msg = to_cut_fill_array(STATE)
    msg.layout.dim[0].label += ",new_m"
    msg.layout.dim[0].size = msg.layout.dim[0].stride = 6
    msg.data.append(7.0)
    assert from_cut_fill_array(over_the_wire(msg)) == STATE


@pytest.mark.parametrize(
    "state",
    [
        STATE._replace(cut=-1.0),
        STATE._replace(fill=math.nan),
        STATE._replace(time=math.inf),
        STATE._replace(within_tolerance=1.5),
    ],
)
def test_invalid_values_are_rejected(state: CutFillState) -> None:
    with raises(ErrorCode.VALUE, CodecError):
        from_cut_fill_array(to_cut_fill_array(state))
