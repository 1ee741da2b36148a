"""Real-time factor and load of a node, and their levels."""

from __future__ import annotations

import pytest

from msg_bridge.nodes.diagnostics import Level
from msg_bridge.nodes.real_time_monitor import LoadMeter, OverloadMonitor

TICK = 0.01


def levels(fractions: list[float], *, judge: bool = True) -> list[Level]:
    """Return the level after each second in which time advances by a fraction of a second."""
    monitor, progress, found = OverloadMonitor(resolution=TICK), 0.0, []
    monitor.update(0.0, 0.0, 0.0, judge=judge)
    for second, fraction in enumerate(fractions, start=1):
        progress += fraction
        monitor.update(second, progress, second, judge=judge)
        assert monitor.fraction == pytest.approx(fraction)
        found.append(monitor.level)
    return found


def test_slow_clock_is_reported_after_two_seconds_until_it_ends() -> None:
    ok, warn = Level.OK, Level.WARN
    assert levels([1.0, 0.8, 0.8, 0.9, 0.97, 0.8]) == [ok, ok, warn, warn, ok, ok]


def test_very_slow_clock_is_an_error_as_long_as_it_is_very_slow() -> None:
    ok, warn, error = Level.OK, Level.WARN, Level.ERROR
    assert levels([0.8, 0.3, 0.3, 0.3, 0.8]) == [ok, warn, error, error, warn]


def test_clock_that_stands_still_is_an_error() -> None:
    assert levels([0.0, 0.0])[-1] is Level.ERROR


def test_slow_clock_is_not_reported_while_it_is_not_judged() -> None:
    assert set(levels([0.1] * 5, judge=False)) == {Level.OK}


def test_one_tick_less_than_expected_is_no_deviation() -> None:
    monitor = OverloadMonitor(resolution=0.2)
    for second in range(10):
        monitor.update(second, 0.2 * (5 * second - 1), second, judge=True)
        monitor.update(second + 0.5, 0.2 * (5 * second + 1), second + 0.5, judge=True)
    assert monitor.level is Level.OK


def test_comparison_begins_again_after_a_restart() -> None:
    monitor = OverloadMonitor(resolution=TICK)
    for second in range(5):
        monitor.update(second, 0.1 * second, second, judge=True)
    assert monitor.level is Level.ERROR
    monitor.restart()
    monitor.update(100.0, 0.0, 100.0, judge=True)
    assert (monitor.level, monitor.fraction, monitor.low_time) == (Level.OK, 0.0, 0.0)


def test_load_is_computing_time_over_tick_period() -> None:
    meter = LoadMeter()
    for duration in (0.002, 0.004, 0.012):
        meter.record(duration)
    load = meter.take(TICK)
    assert (load.mean, load.maximum, load.num_ticks) == pytest.approx((0.6, 1.2, 3))
    assert meter.take(TICK).num_ticks == 0
