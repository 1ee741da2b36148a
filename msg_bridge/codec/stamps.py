"""Simulation time as stamps: whole nanoseconds, rounded once, so that it never drifts."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import cache

from builtin_interfaces.msg import Time

from msg_bridge.codec.errors import CodecError

__all__ = ["seconds_from_stamp", "stamp_from_seconds", "stamp_from_tick", "tick_from_stamp"]

_NANO = 10**9


def stamp_from_seconds(seconds: float) -> Time:
    """The stamp nearest to a simulation time [s].

    Raises:
        CodecError: not a time a stamp can hold.
    """
    if not math.isfinite(seconds):
        raise CodecError(f"a simulation time of {seconds} s has no stamp")
    return _stamp(round(Fraction(seconds) * _NANO))


def seconds_from_stamp(stamp: Time) -> float:
    """Simulation time of a stamp [s], the nearest float64."""
    return _nanoseconds(stamp) / _NANO


def stamp_from_tick(tick: int, period: float) -> Time:
    """The end of a tick; tick 0 ends at time 0.

    Args:
        tick: its number.
        period: length of a tick [s].

    Raises:
        CodecError: the period is not positive, or the time is beyond what a stamp can hold.
    """
    return _stamp(round(tick * _period_in_nanoseconds(period)))


def tick_from_stamp(stamp: Time, period: float) -> int:
    """The tick that ends at a stamp.

    Raises:
        CodecError: no tick ends there.
    """
    nanoseconds = _nanoseconds(stamp)
    tick = round(nanoseconds / _period_in_nanoseconds(period))
    if round(tick * _period_in_nanoseconds(period)) != nanoseconds:
        raise CodecError(
            f"no tick of {period} s ends at {nanoseconds} ns; sender and receiver differ in it"
        )
    return tick


@cache
def _period_in_nanoseconds(period: float) -> Fraction:
    """A tick's length [ns], as the decimal number that it is written as: 0.01 is 1/100 then."""
    if not (math.isfinite(period) and period >= 1e-9):
        raise CodecError(f"a tick of {period} s is not at least a nanosecond long")
    return Fraction(repr(float(period))) * _NANO


def _nanoseconds(stamp: Time) -> int:
    return int(stamp.sec) * _NANO + int(stamp.nanosec)


def _stamp(nanoseconds: int) -> Time:
    seconds, rest = divmod(nanoseconds, _NANO)
    if not 0 <= seconds < 2**31:
        raise CodecError(f"{seconds} s is not a simulation time; stamps go from 0 to 2**31 s")
    return Time(sec=seconds, nanosec=rest)
