"""Machines that send nothing: when the soil run reports them, and when it drops them."""

from __future__ import annotations

import pytest
from support.soil_timeline import Timeline

from msg_bridge.contract.messages import MachineHeader, Verb
from soil_sim.node.soil_run import MAX_CHECK_INTERVAL, SilentMachine


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
