"""Stamps have simulation time to the nanosecond, in runs of any length."""

import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from support.wire import raises

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.stamps import (
    clock_time_ns,
    seconds_from_stamp,
    stamp_from_seconds,
    stamp_from_tick,
    tick_from_stamp,
)
from msg_bridge.contract.errors import ErrorCode

LAST_TICK_OF_10_MS = 2**31 * 100 - 1


@given(st.integers(0, LAST_TICK_OF_10_MS))
def test_ticks_of_10_ms_do_not_drift(tick: int) -> None:
    stamp = stamp_from_tick(tick, 0.01)
    assert stamp.sec * 10**9 + stamp.nanosec == tick * 10**7


@given(st.integers(0, 10**9), st.sampled_from([0.01, 0.005, 1 / 240, 1 / 3, 0.02]))
def test_tick_of_a_stamp(tick: int, period: float) -> None:
    assert tick_from_stamp(stamp_from_tick(tick, period), period) == tick


def test_stamp_between_ticks_is_rejected() -> None:
    with raises(ErrorCode.STAMP, CodecError):
        tick_from_stamp(Time(nanosec=15_000_000), 0.01)


@given(st.integers(0, 2**52))
def test_nanoseconds_are_kept_in_seconds(nanoseconds: int) -> None:
    seconds, rest = divmod(nanoseconds, 10**9)
    stamp = Time(sec=seconds, nanosec=rest)
    assert stamp_from_seconds(seconds_from_stamp(stamp)) == stamp


def test_stamps_do_not_accumulate_rounding_errors() -> None:
    summed = sum([0.01] * 1000)
    assert summed != 10.0
    assert stamp_from_tick(1000, 0.01) == stamp_from_seconds(10.0) == Time(sec=10)


@pytest.mark.parametrize("seconds", [float("nan"), float("inf"), -1e-9, 2.0**31])
def test_time_outside_the_range_of_stamps_is_rejected(seconds: float) -> None:
    with raises(ErrorCode.STAMP, CodecError):
        stamp_from_seconds(seconds)


@pytest.mark.parametrize("period", [0.0, -0.01, float("nan"), float("inf"), 1e-10])
def test_invalid_tick_period_is_rejected(period: float) -> None:
    with raises(ErrorCode.STAMP, CodecError):
        stamp_from_tick(1, period)


@pytest.mark.parametrize(
    ("seconds", "nanoseconds", "time"), [(2, 5, 2 * 10**9 + 5), (-1, 5, None), (0, 0, 0)]
)
def test_time_of_a_serialised_clock_is_not_negative(
    seconds: int, nanoseconds: int, time: int | None
) -> None:
    data = serialize_message(Clock(clock=Time(sec=seconds, nanosec=nanoseconds)))
    assert clock_time_ns(data) == time
    assert clock_time_ns(data[:7]) is None
