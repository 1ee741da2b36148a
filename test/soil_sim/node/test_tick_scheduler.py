"""Tick scheduler on a simulated wall clock: due, overdue and late ticks, lost time."""

import pytest

from soil_sim.node.tick_scheduler import LATE_FRACTION, MAX_CATCH_UP_TIME, TickScheduler

TICK = 0.01
START = 1000.0


def at(ticks: float) -> float:
    """Return the wall time a number of ticks after the first timer call [s]."""
    return START + ticks * TICK


@pytest.fixture
def scheduler() -> TickScheduler:
    """Return a scheduler whose timer was first called at `START`."""
    started = TickScheduler(TICK)
    started.on_timer(START)
    return started


def complete_due_ticks(scheduler: TickScheduler, now: float) -> int:
    """Complete ticks until none is due; return their number."""
    count = 0
    while scheduler.is_due:
        scheduler.mark_done(now)
        count += 1
    return count


def test_no_tick_is_due_before_the_timer_has_fired() -> None:
    assert not TickScheduler(TICK).is_due


def test_first_call_starts_the_schedule_without_a_tick(scheduler: TickScheduler) -> None:
    assert not scheduler.is_due


def test_one_tick_is_due_per_period(scheduler: TickScheduler) -> None:
    counts = []
    for tick in range(1, 6):
        scheduler.on_timer(at(tick))
        counts.append(complete_due_ticks(scheduler, at(tick)))
    assert counts == [1] * 5
    assert (scheduler.num_late_ticks, scheduler.lost_time) == (0, 0.0)


def test_timer_jitter_does_not_change_the_number_of_ticks(scheduler: TickScheduler) -> None:
    counts = []
    for tick in range(1, 200):
        now = at(tick + 0.4 * (-1) ** tick)
        scheduler.on_timer(now)
        counts.append(complete_due_ticks(scheduler, now))
    assert counts == [1] * 199


def test_missed_timer_call_is_caught_up(scheduler: TickScheduler) -> None:
    scheduler.on_timer(at(3))
    assert complete_due_ticks(scheduler, at(3)) == 3


def test_tick_is_overdue_once_the_next_is_due(scheduler: TickScheduler) -> None:
    scheduler.on_timer(at(1))
    assert (scheduler.is_due, scheduler.is_overdue) == (True, False)
    scheduler.on_timer(at(2))
    assert scheduler.is_overdue
    scheduler.mark_done(at(2))
    assert (scheduler.is_due, scheduler.is_overdue) == (True, False)


def test_tick_completed_after_its_time_is_late(scheduler: TickScheduler) -> None:
    scheduler.on_timer(at(1))
    scheduler.mark_done(at(1 + 0.9 * LATE_FRACTION))
    assert scheduler.num_late_ticks == 0
    scheduler.on_timer(at(2))
    scheduler.mark_done(at(2 + 1.1 * LATE_FRACTION))
    assert scheduler.num_late_ticks == 1


def test_short_lag_is_caught_up(scheduler: TickScheduler) -> None:
    scheduler.on_timer(START + MAX_CATCH_UP_TIME)
    assert complete_due_ticks(scheduler, START + MAX_CATCH_UP_TIME) == 10
    assert scheduler.lost_time == 0.0


def test_lag_beyond_the_limit_is_lost(scheduler: TickScheduler) -> None:
    scheduler.on_timer(START + 60.0)
    assert complete_due_ticks(scheduler, START + 60.0) == 10
    assert scheduler.lost_time == pytest.approx(60.0 - MAX_CATCH_UP_TIME)
    counts = []
    for tick in range(1, 11):
        now = START + 60.0 + tick * TICK
        scheduler.on_timer(now)
        counts.append(complete_due_ticks(scheduler, now))
    assert counts == [1] * 10


@pytest.mark.parametrize("period", [TICK, 0.2])
def test_every_tick_of_a_slow_host_is_late_and_the_lag_remains_bounded(period: float) -> None:
    scheduler = TickScheduler(period)
    scheduler.on_timer(START)
    now = START
    for _ in range(200):  # each tick takes two periods
        now += 2 * period
        scheduler.on_timer(now)
        scheduler.mark_done(now)
    assert scheduler.num_late_ticks == pytest.approx(200, abs=2)
    max_lag = max(MAX_CATCH_UP_TIME, 2 * period)
    assert scheduler.lost_time == pytest.approx(200 * period, abs=max_lag + period)
    assert complete_due_ticks(scheduler, now) * period <= max_lag + 1e-9


def test_stopped_schedule_does_not_catch_up(
    scheduler: TickScheduler,
) -> None:
    scheduler.on_timer(at(5))
    scheduler.stop()
    assert not scheduler.is_due
    scheduler.on_timer(at(1000))
    assert not scheduler.is_due
    scheduler.on_timer(at(1001))
    assert complete_due_ticks(scheduler, at(1001)) == 1
    assert scheduler.lost_time == 0.0


def test_completing_a_tick_that_is_not_due_is_an_error() -> None:
    with pytest.raises(AssertionError):
        TickScheduler(TICK).mark_done(START)
