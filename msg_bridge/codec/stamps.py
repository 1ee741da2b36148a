"""Simulation time as stamps: integer nanoseconds, rounded once, so that they do not drift."""

from __future__ import annotations

import math
from fractions import Fraction
from functools import cache

from builtin_interfaces.msg import Time

from msg_bridge.codec.cdr_primitives import LITTLE_ENDIAN, STAMP
from msg_bridge.codec.errors import CodecError
from msg_bridge.contract.errors import ErrorCode

__all__ = [
    "clock_time_ns",
    "seconds_from_stamp",
    "stamp_from_nanoseconds",
    "stamp_from_seconds",
    "stamp_from_tick",
    "tick_from_stamp",
]

_NANO = 10**9


def stamp_from_seconds(seconds: float) -> Time:
    """Return the stamp nearest to a simulation time [s].

    Raises:
        CodecError: STAMP: outside the range of a stamp.
    """
    if not math.isfinite(seconds):
        raise CodecError(f"a simulation time is {seconds} s; give a finite number", ErrorCode.STAMP)
    return stamp_from_nanoseconds(round(Fraction(seconds) * _NANO))


def seconds_from_stamp(stamp: Time) -> float:
    """Return the simulation time of a stamp [s], the nearest float64."""
    return _nanoseconds(stamp) / _NANO


def stamp_from_tick(tick: int, period: float) -> Time:
    """Return the stamp of the end of a tick; tick 0 ends at time 0.

    Args:
        tick: its number.
        period: tick period [s].

    Raises:
        CodecError: STAMP: the period is below 1 ns, or the time is outside the range of a stamp.
    """
    return stamp_from_nanoseconds(round(tick * _period_in_nanoseconds(period)))


def tick_from_stamp(stamp: Time, period: float) -> int:
    """Return the tick that ends at a stamp.

    Raises:
        CodecError: STAMP: no tick ends there.
    """
    nanoseconds = _nanoseconds(stamp)
    tick = round(nanoseconds / _period_in_nanoseconds(period))
    if round(tick * _period_in_nanoseconds(period)) != nanoseconds:
        raise CodecError(
            f"no tick of {period} s ends at {nanoseconds} ns; use the tick period of the sender",
            ErrorCode.STAMP,
        )
    return tick


def clock_time_ns(data: bytes) -> int | None:
    """Return the time of a serialised rosgraph_msgs/Clock [ns]; None if it is negative.

    Args:
        data: its CDR bytes, little-endian.
    """
    if len(data) < len(LITTLE_ENDIAN) + STAMP.size:
        return None
    seconds, nanoseconds = STAMP.unpack_from(data, len(LITTLE_ENDIAN))
    return int(seconds) * _NANO + int(nanoseconds) if seconds >= 0 else None


@cache
def _period_in_nanoseconds(period: float) -> Fraction:
    """Return the tick period [ns] as the exact value of its decimal form: 0.01 is 1/100."""
    if not (math.isfinite(period) and period >= 1e-9):
        raise CodecError(f"a tick period is {period} s; give at least 1e-9 s", ErrorCode.STAMP)
    return Fraction(repr(float(period))) * _NANO


def _nanoseconds(stamp: Time) -> int:
    return int(stamp.sec) * _NANO + int(stamp.nanosec)


def stamp_from_nanoseconds(nanoseconds: int) -> Time:
    """Return the stamp of a time.

    Raises:
        CodecError: STAMP: it is negative or 2**31 s or later.
    """
    seconds, remainder = divmod(nanoseconds, _NANO)
    if not 0 <= seconds < 2**31:
        raise CodecError(
            f"a simulation time is {seconds} s; give 0 s to 2**31 - 1 s", ErrorCode.STAMP
        )
    return Time(sec=seconds, nanosec=remainder)
