"""When the wall clock asks for a tick, by a clock of the test's own."""

import pytest

from soil_sim.pace import LATE, Pace

TICK = 0.01
START = 1000.0


def at(ticks: float) -> float:
    """The wall clock so many ticks after the timer's first call [s]."""
    return START + ticks * TICK


@pytest.fixture
def pace() -> Pace:
    """A schedule that begins now."""
    begun = Pace(TICK)
    begun.on_time(START)
    return begun


def dues(pace: Pace, now: float) -> int:
    """Ticks done one after the other until none is due."""
    count = 0
    while pace.due:
        pace.done(now)
        count += 1
    return count


def test_nothing_is_due_before_the_timer_has_fired() -> None:
    assert not Pace(TICK).due


def test_the_first_call_only_begins_the_schedule(pace: Pace) -> None:
    assert not pace.due


def test_each_period_asks_for_one_tick(pace: Pace) -> None:
    asked = []
    for tick in range(1, 6):
        pace.on_time(at(tick))
        asked.append(dues(pace, at(tick)))
    assert asked == [1] * 5
    assert (pace.late, pace.slips) == (0, 0)


def test_a_timer_that_jitters_asks_for_one_tick_all_the_same(pace: Pace) -> None:
    asked = []
    for tick in range(1, 200):
        now = at(tick + 0.4 * (-1) ** tick)
        pace.on_time(now)
        asked.append(dues(pace, now))
    assert asked == [1] * 199


def test_a_call_that_is_left_out_is_made_up_for(pace: Pace) -> None:
    pace.on_time(at(3))
    assert dues(pace, at(3)) == 3


def test_a_tick_is_overdue_once_the_next_is_due_too(pace: Pace) -> None:
    pace.on_time(at(1))
    assert (pace.due, pace.overdue) == (True, False)
    pace.on_time(at(2))
    assert pace.overdue
    pace.done(at(2))
    assert (pace.due, pace.overdue) == (True, False)


def test_a_tick_done_after_its_time_counts_as_late(pace: Pace) -> None:
    pace.on_time(at(1))
    pace.done(at(1 + 0.9 * LATE))
    assert pace.late == 0
    pace.on_time(at(2))
    pace.done(at(2 + 1.1 * LATE))
    assert pace.late == 1


def test_a_short_lag_is_caught_up_with(pace: Pace) -> None:
    pace.on_time(START + 0.5)
    assert dues(pace, START + 0.5) == 50
    assert pace.slips == 0


def test_after_a_long_stop_the_schedule_is_moved_and_goes_on_at_its_pace(pace: Pace) -> None:
    pace.on_time(START + 60.0)
    assert dues(pace, START + 60.0) == 1
    assert pace.slips == 1
    asked = []
    for tick in range(1, 11):
        now = START + 60.0 + tick * TICK
        pace.on_time(now)
        asked.append(dues(pace, now))
    assert asked == [1] * 10
    assert pace.slips == 1


def test_a_host_too_slow_for_real_time_slips_again_and_again(pace: Pace) -> None:
    now = START
    for _ in range(200):  # each tick takes two
        now += 2 * TICK
        pace.on_time(now)
        if pace.due:
            pace.done(now)
    assert pace.slips == 4  # each time it is half a second behind
    assert pace.late > 150


def test_a_schedule_that_was_stopped_does_not_ask_for_the_time_in_between(pace: Pace) -> None:
    pace.on_time(at(5))
    pace.stop()
    assert not pace.due
    pace.on_time(at(1000))
    assert not pace.due
    pace.on_time(at(1001))
    assert dues(pace, at(1001)) == 1
    assert pace.slips == 0


def test_a_tick_that_was_not_due_cannot_be_done() -> None:
    with pytest.raises(AssertionError):
        Pace(TICK).done(START)
