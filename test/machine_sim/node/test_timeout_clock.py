"""Clock of command timeouts in real time."""

from __future__ import annotations

import pytest

from machine_sim.node.timeout_clock import MAX_COMMAND_LEAD, STANDSTILL_TIME, TimeoutClock

TICK = 0.01


def elapsed(wall_period: float, ticks: int) -> float:
    """Return the time that passes while each tick takes `wall_period` [s]."""
    clock = TimeoutClock()
    times = [clock.tick(wall_period * k, TICK * k) for k in range(ticks + 1)]
    assert times == sorted(times)
    return times[-1] - times[0]


def test_clock_follows_the_wall_clock_in_real_time() -> None:
    assert elapsed(TICK, 100) == pytest.approx(1.0)


def test_clock_follows_a_fast_simulation_by_wall_time() -> None:
    assert elapsed(0.2 * TICK, 100) == pytest.approx(0.2)


@pytest.mark.parametrize("slowness", [2, 10, 50])
def test_clock_of_a_slow_simulation_is_little_faster_than_it(slowness: int) -> None:
    assert elapsed(slowness * TICK, 100) == pytest.approx(1.0 + MAX_COMMAND_LEAD, abs=TICK)


def test_short_stall_that_is_caught_up_counts_once() -> None:
    clock = TimeoutClock()
    clock.tick(0.0, 0.0)
    clock.tick(0.08, TICK)
    for k in range(2, 9):  # catches up
        time = clock.tick(0.08, k * TICK)
    assert time == pytest.approx(0.08)


def test_all_of_a_standstill_counts() -> None:
    clock = TimeoutClock()
    before = clock.tick(5.0, 0.0)
    pause = 10.0 * STANDSTILL_TIME
    during = clock.now(5.0 + pause - 0.1)
    after = clock.tick(5.0 + pause, TICK)
    assert after - before == pytest.approx(pause)
    assert after - during == pytest.approx(0.1), "a command from the end of the pause is young"


def test_no_command_is_younger_than_the_tick_in_which_it_takes_effect() -> None:
    clock = TimeoutClock()
    for k in range(200):
        wall = 0.07 * k
        arrival = clock.now(wall)
        assert arrival <= clock.tick(wall, TICK * k)
