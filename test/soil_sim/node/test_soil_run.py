"""Timing of the soil run: when a tick is due and what it waits for, on a simulated clock."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from support.soil_scenes import bucket_sweep, flat_soil, make_deposit_requests

from msg_bridge.contract.messages import MachineHeader, Verb
from msg_bridge.contract.rows import Rows
from msg_bridge.exchange.join_state import JoinState
from msg_bridge.exchange.machine_account import signed_volume
from msg_bridge.exchange.machine_exchange import MachineExchange
from soil_sim.node.params import SoilNodeParams
from soil_sim.node.soil_run import MAX_CHECK_INTERVAL, SilentMachine, SoilRun
from soil_sim.node.tick_scheduler import MAX_CATCH_UP_TIME
from soil_sim.site.cut_fill import compare_to_design
from soil_sim.site.design import DesignSurface
from soil_sim.site.site import Site
from soil_sim.soils.params import SoilParams
from soil_sim.terrain import Layers, flat

TICK = 0.01
AT_REST = bucket_sweep((0, 0, 1), (0, 0, 1))


class Timeline:
    """A soil run, the exchange ends of machines, and a simulated wall clock."""

    def __init__(self, *machines: int, site: Site | None = None, **params: Any) -> None:
        given = {
            "expected_machines": machines,
            "machine_timeout": 1.0,
            "tick_period": TICK,
            **params,
        }
        site = site or Site(flat(flat_soil().grid))
        self.run = SoilRun(site, SoilParams(), SoilNodeParams(**given), run_id=7)
        self.machines = {
            machine_id: MachineExchange(machine_id, run_id=7) for machine_id in machines
        }
        self.soil_mm3 = dict.fromkeys(machines, 0)  # of each machine
        self.now = 100.0
        for machine in self.machines.values():
            machine.join()
        self.exchange()
        self.ticks()  # the welcome, if all machines have joined

    def exchange(self) -> None:
        """Deliver all messages in both directions."""
        for machine in self.machines.values():
            for message in machine.drain_outbox():
                self.run.endpoint.receive(message)
        for message in self.run.endpoint.drain_outbox():
            for machine in self.machines.values():
                machine.receive(message)
        for machine_id, machine in self.machines.items():
            answer = machine.poll()
            if answer is not None:
                self.soil_mm3[machine_id] += signed_volume(answer.conversions)
                machine.acknowledge_answer()

    def send(self, machine_id: int, sweep: Rows = AT_REST) -> None:
        """Deliver the next tick of a machine."""
        nothing = make_deposit_requests([], [], 0)
        held = self.soil_mm3[machine_id]
        self.machines[machine_id].send(sweep.copy(), nothing, pending_mm3=held, particles_mm3=0)
        self.exchange()

    def ticks(self) -> int:
        """Compute all ticks that are possible now; return their number."""
        count = 0
        while self.run.advance(self.now) is not None:
            count += 1
        self.exchange()
        return count

    def wait(self, ticks: float) -> int:
        """Advance the wall clock and fire the timer; return the number of ticks computed."""
        self.now += ticks * TICK
        self.run.on_timer(self.now)
        return self.ticks()


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


@pytest.mark.parametrize("sync", ["lockstep", "realtime"])
def test_silent_machine_is_reported_after_the_timeout_and_dropped_in_real_time_only(
    sync: str,
) -> None:
    time = Timeline(1, 2, sync=sync)
    time.send(2)
    received = {1: time.now, 2: time.now}
    assert time.run.check_silent_machines(time.now + 0.9, received) == []
    found = time.run.check_silent_machines(time.now + 1.5, received)
    assert found == [SilentMachine(1, 1.5, is_dropped=sync == "realtime")]
    assert time.run.endpoint.exchange.joined == ((2,) if sync == "realtime" else (1, 2))


@pytest.mark.parametrize("is_repeated", [True, False])
def test_silent_machine_is_dropped_in_lockstep_while_another_session_requests_to_join(
    is_repeated: bool,
) -> None:
    time = Timeline(1, sync="lockstep")
    request = MachineHeader(7, 1, 77, -1, Verb.JOIN)
    time.run.endpoint.receive(request)
    received = {1: time.now}
    silent = []
    for _ in range(8):
        if is_repeated:
            time.run.endpoint.receive(request)
        silent = time.run.check_silent_machines(time.now, received)
        if silent:
            break
        time.now += 0.25
    assert silent == [SilentMachine(1, 1.0, is_dropped=is_repeated)]
    assert time.run.endpoint.exchange.joined == (() if is_repeated else (1,))


def test_machine_that_is_not_waited_for_is_not_silent() -> None:
    time = Timeline(1, sync="lockstep")
    later = time.now + 10.0
    time.run.pause(True)
    assert time.run.check_silent_machines(later, {1: time.now}) == []
    time.run.step()
    assert [each.machine_id for each in time.run.check_silent_machines(later, {1: time.now})] == [1]


def test_machine_without_messages_is_silent_after_the_timeout() -> None:
    time = Timeline(1, sync="lockstep")
    assert time.run.check_silent_machines(time.now, {}) == []
    for passed in (0.5, 1.0):  # the soil node runs on meanwhile
        silent = time.run.check_silent_machines(time.now + passed, {})
    assert [each.machine_id for each in silent] == [1]


def test_silent_machine_is_not_dropped_by_a_step_in_real_time() -> None:
    time = Timeline(1, sync="realtime")
    time.run.pause(True)
    time.run.step()
    assert [
        each.is_dropped for each in time.run.check_silent_machines(time.now + 10.0, {1: time.now})
    ] == [False]
    assert time.run.endpoint.exchange.joined == (1,)


def test_silence_does_not_count_while_a_large_terrain_is_received() -> None:
    time = Timeline(1)
    received = {1: time.now}
    time.run.expect_keyframe(time.now, 200_000_000)  # 10 s at 20 MB/s
    for k in range(1, 22):
        assert time.run.check_silent_machines(time.now + 0.5 * k, received) == []
    (silent,) = time.run.check_silent_machines(time.now + 11.0, received)
    assert silent.duration == pytest.approx(1.0)


def test_stall_of_the_soil_itself_is_no_silence_of_a_machine() -> None:
    time = Timeline(1)
    received = {1: time.now}
    assert time.run.check_silent_machines(time.now + 0.5, received) == []
    stalled_until = time.now + 0.5 + 2.0 * MAX_CHECK_INTERVAL
    assert time.run.check_silent_machines(stalled_until, received) == []
    assert time.run.check_silent_machines(stalled_until + 0.9, received) == []
    (silent,) = time.run.check_silent_machines(stalled_until + 1.2, received)
    assert silent.duration == pytest.approx(1.2)


def site_with_design(depth: float) -> Site:
    """Return level ground with a design that has a pit in the middle and is NaN elsewhere."""
    grid = flat_soil().grid
    heights = np.full(grid.shape, np.nan)
    heights[20:40, 20:40] = -depth
    return Site(flat(grid), design=DesignSurface(grid, heights))


def dig(time: Timeline, ticks: int) -> None:
    """Drag a bucket through the pit of the design."""
    x = 0.02 * np.arange(ticks + 1) - 0.5
    for a, b in pairwise(x.tolist()):
        time.send(1, bucket_sweep((a, 0.0, -0.3), (b, 0.0, -0.3)))
        assert time.ticks() == 1


def test_run_without_design_has_no_cut_and_fill() -> None:
    assert Timeline().run.cut_fill is None


def test_cut_and_fill_are_updated_exactly_without_comparing_the_whole_design_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    site, comparisons = site_with_design(0.5), []
    monkeypatch.setattr(
        "soil_sim.site.site.compare_to_design",
        lambda *a, **k: comparisons.append(1) or compare_to_design(*a, **k),
    )
    time = Timeline(1, site=site, sync="lockstep")
    assert time.run.cut_fill is not None
    assert time.run.cut_fill.cut == pytest.approx(400 * 0.04 * 0.5)
    for _ in range(3):
        before = time.run.cut_fill.cut_mm3
        dig(time, 10)
        assert time.run.cut_fill.cut_mm3 < before
        assert site.design is not None
        expected = compare_to_design(site.design, time.run.endpoint.soil.columns.height)
        now = time.run.cut_fill
        assert (now.cut_mm3, now.fill_mm3) == (expected.cut_mm3, expected.fill_mm3)
        assert now.within_tolerance == expected.within_tolerance
        assert np.array_equal(now.difference, expected.difference, equal_nan=True)
    assert len(comparisons) == 1


def test_reset_restores_the_cut_volume() -> None:
    time = Timeline(1, site=site_with_design(0.5), sync="lockstep")
    assert time.run.cut_fill is not None
    initial = time.run.cut_fill.cut_mm3
    dig(time, 20)
    assert time.run.cut_fill.cut_mm3 < initial
    time.run.reset()
    assert time.run.cut_fill.cut_mm3 == initial


def test_reset_restores_the_layers_of_the_site() -> None:
    grid = flat_soil().grid
    ids = np.ones(grid.shape, dtype=np.uint8)
    moisture = np.full(grid.shape, 37, dtype=np.uint8)
    site = Site(flat(grid), Layers(ids, moisture))
    soil = SoilParams(additional_soils=("dry clay",))
    run = SoilRun(site, soil, SoilNodeParams(expected_machines=()), run_id=7)
    for _ in range(2):
        columns = run.endpoint.soil.columns
        assert (columns.soil == 1).all()
        assert (columns.moisture == 37).all()
        columns.soil[:], columns.moisture[:] = 0, 0
        run.reset()


def test_machine_that_has_just_rejoined_is_not_silent() -> None:
    time = Timeline(1)
    last = {1: time.now}
    (silent,) = time.run.check_silent_machines(time.now + 1.5, last)
    assert silent.is_dropped
    for _ in range(3):
        time.wait(1)
    assert time.machines[1].dropped
    time.machines[1].join()
    time.exchange()
    for _ in range(3):
        time.wait(1)
    assert time.run.endpoint.exchange.joined == (1,)
    assert time.run.check_silent_machines(time.now + 1.6, last) == []
    assert time.run.endpoint.exchange.joined == (1,)
