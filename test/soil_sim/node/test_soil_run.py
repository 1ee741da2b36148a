"""Timing of the soil run: when a tick is due and what it waits for, on a simulated clock."""

from __future__ import annotations

import pytest
from support.soil_scenes import bucket_sweep, make_deposit_requests
from support.soil_timeline import TICK, Timeline

from msg_bridge.exchange.join_state import JoinState
from msg_bridge.exchange.machine_exchange import MachineExchange
from soil_sim.node.tick_scheduler import MAX_CATCH_UP_TIME


def test_welcome_is_tick_0_and_waits_until_all_machines_have_joined() -> None:
    assert Timeline(1, 2).run.tick == 0
    waiting = Timeline(1)
    waiting.run.reset()
    assert waiting.ticks() == 0
    assert waiting.run.tick == -1


def test_welcome_waits_for_required_subscribers() -> None:
    time = Timeline(sync="lockstep")
    time.run.reset()
    time.run.waiting_for_subscribers = True
    assert time.ticks() == 0
    time.run.waiting_for_subscribers = False
    assert time.ticks() == 1


def test_lockstep_tick_waits_for_all_machines() -> None:
    time = Timeline(1, 2, sync="lockstep")
    time.send(1)
    assert time.ticks() == 0
    time.send(2)
    assert time.ticks() == 1
    assert time.ticks() == 0


def test_lockstep_is_independent_of_the_wall_clock() -> None:
    time = Timeline(1, sync="lockstep")
    assert time.wait(1000) == 0
    assert time.run.tick == 0


def test_real_time_tick_waits_for_its_time() -> None:
    time = Timeline(1)
    assert time.wait(0) == 0  # begins the schedule
    time.send(1)
    assert time.ticks() == 0
    assert time.wait(1) == 1


def test_real_time_continues_without_machines() -> None:
    time = Timeline()
    time.wait(0)
    assert [time.wait(1) for _ in range(5)] == [1] * 5


def test_skipped_tick_is_waited_for_until_the_next_one_is_due() -> None:
    time = Timeline(1, overload="skip_ticks")
    time.wait(0)
    assert time.wait(1) == 0
    assert time.wait(1) == 1  # without it
    assert time.run.endpoint.exchange.late == (1,)
    time.send(1)
    assert time.ticks() == 1  # with it


def test_slow_clock_waits_for_a_late_machine_and_then_catches_up_a_short_delay_only() -> None:
    time = Timeline(1)
    time.wait(0)
    assert [time.wait(1) for _ in range(30)] == [0] * 30
    num_caught_up = 0
    for _ in range(30):
        if time.machines[1].join_state is JoinState.READY:
            time.send(1)
        num_caught_up += time.ticks()
    assert num_caught_up == round(MAX_CATCH_UP_TIME / TICK)
    assert time.run.scheduler.lost_time == pytest.approx(30 * TICK - MAX_CATCH_UP_TIME)


def test_machine_makes_every_tick_of_a_slow_clock() -> None:
    time, ticks = Timeline(1), []
    time.wait(0)
    for _ in range(20):  # the machine takes three periods for a tick
        time.wait(3)
        time.send(1)
        ticks.append(time.machines[1].sent_tick)
        time.ticks()
    assert ticks == list(range(1, 21))


def test_late_tick_is_attributed_to_the_machine_that_was_waited_for() -> None:
    time = Timeline(1, 2)
    time.wait(0)
    for _ in range(10):
        time.send(2)
        time.wait(2)
        time.send(1)
        time.ticks()
    assert time.run.scheduler.num_late_ticks == 10
    assert time.run.num_late_ticks_by_machine == {1: 10}


def test_paused_run_computes_requested_steps_only() -> None:
    time = Timeline(sync="realtime")
    time.wait(0)
    time.run.pause(True)
    assert time.wait(10) == 0
    assert time.run.step() == 1
    assert time.run.step() == 2
    assert not time.run.realtime


def test_step_waits_for_all_machines() -> None:
    time = Timeline(1, sync="realtime")
    time.run.pause(True)
    assert time.run.step() == 1
    assert time.wait(100) == 0
    time.send(1)
    assert time.ticks() == 1
    time.send(1)
    assert time.ticks() == 0


@pytest.mark.parametrize("sync", ["lockstep", "realtime"])
def test_step_without_machines_is_computed_at_once(sync: str) -> None:
    time = Timeline(sync=sync)
    time.run.pause(True)
    time.run.step()
    assert time.ticks() == 1


def test_lockstep_stands_still_without_machines() -> None:
    assert Timeline(sync="lockstep").ticks() == 0


def test_schedule_continues_after_a_pause_without_catching_up() -> None:
    time = Timeline()
    time.wait(0)
    time.wait(1)
    time.run.pause(True)
    time.wait(1000)
    time.run.pause(False)
    assert time.wait(0) == 0
    assert time.wait(1) == 1
    assert (time.run.tick, time.run.scheduler.lost_time) == (2, 0.0)


def test_run_can_start_paused() -> None:
    time = Timeline(1, sync="lockstep", paused=True)
    assert time.run.tick == 0
    time.send(1)
    assert time.ticks() == 0


def test_reset_starts_the_next_run_on_the_initial_site() -> None:
    time = Timeline(1, sync="lockstep")
    initial = time.run.endpoint.soil.state_hash()
    down = bucket_sweep((0, 0, -0.1), (-0.1, 0, -0.2))
    nothing = make_deposit_requests([], [], 0)
    time.machines[1].send(down, nothing, pending_mm3=0, particles_mm3=0)
    time.exchange()
    time.ticks()
    assert time.run.endpoint.soil.state_hash() != initial
    time.run.reset()
    assert (time.run.tick, time.run.endpoint.exchange.run_id) == (-1, 8)
    assert time.run.endpoint.soil.state_hash() == initial


def test_reset_cancels_pending_steps() -> None:
    time = Timeline(1, sync="lockstep")
    time.run.pause(True)
    for _ in range(3):
        time.run.step()
    time.run.reset()
    time.machines[1] = MachineExchange(1, run_id=8)
    time.machines[1].join()
    time.exchange()
    assert time.ticks() == 1  # the welcome
    time.exchange()
    time.send(1)
    assert time.ticks() == 0
