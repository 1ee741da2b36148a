"""Stamps hold simulation time to the nanosecond, however long a run lasts."""

import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.stamps import (
    seconds_from_stamp,
    stamp_from_seconds,
    stamp_from_tick,
    tick_from_stamp,
)

LAST_TICK_OF_10_MS = 2**31 * 100 - 1


@given(st.integers(0, LAST_TICK_OF_10_MS))
def test_ticks_of_10_ms_do_not_drift(tick: int) -> None:
    stamp = stamp_from_tick(tick, 0.01)
    assert stamp.sec * 10**9 + stamp.nanosec == tick * 10**7


@given(st.integers(0, 10**9), st.sampled_from([0.01, 0.005, 1 / 240, 1 / 3, 0.02]))
def test_tick_is_told_from_its_stamp(tick: int, period: float) -> None:
    assert tick_from_stamp(stamp_from_tick(tick, period), period) == tick


def test_stamp_between_ticks_is_refused() -> None:
    with pytest.raises(CodecError, match=r"no tick of 0\.01 s ends at 15000000 ns"):
        tick_from_stamp(Time(nanosec=15_000_000), 0.01)


@given(st.integers(0, 2**52))
def test_nanoseconds_survive_seconds(nanoseconds: int) -> None:
    seconds, rest = divmod(nanoseconds, 10**9)
    stamp = Time(sec=seconds, nanosec=rest)
    assert stamp_from_seconds(seconds_from_stamp(stamp)) == stamp


def test_sum_of_ticks_is_not_what_a_stamp_is_made_of() -> None:
    summed = sum([0.01] * 1000)
    assert summed != 10.0
    assert stamp_from_tick(1000, 0.01) == stamp_from_seconds(10.0) == Time(sec=10)


@pytest.mark.parametrize("seconds", [float("nan"), float("inf"), -1e-9, 2.0**31])
def test_time_without_a_stamp_is_refused(seconds: float) -> None:
    with pytest.raises(CodecError, match="stamp"):
        stamp_from_seconds(seconds)


@pytest.mark.parametrize("period", [0.0, -0.01, float("nan"), float("inf"), 1e-10])
def test_impossible_tick_is_refused(period: float) -> None:
    with pytest.raises(CodecError, match="nanosecond"):
        stamp_from_tick(1, period)
