"""Services of the soil node: pause, step, reset, verify, save, release."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_msgs.msg import Bool, String
from std_srvs.srv import Trigger
from support.node_scenes import Scene, dig, machine_file, ready_to_dig
from support.soil_node_scenes import NO_MACHINES, excavating_scene, layered_site_parameters

from machine_sim.node.machine_node import MachineNode
from msg_bridge.codec import qos
from msg_bridge.codec.run_config import parse_run_facts
from msg_bridge.contract.grid import Grid
from msg_bridge.testing.ros_context import Ros
from soil_sim.terrain import load_terrain, load_terrain_with_layers


def test_pause_stops_ticks_until_it_is_released(ros: Ros) -> None:
    paused = ros.collect("/sim/paused", Bool, qos.TRANSIENT_LOCAL)
    scene = Scene(ros, **NO_MACHINES)
    scene.until_tick(2)
    response = scene.pause()
    paused_tick = scene.tick
    assert response.success
    assert response.message == f"paused at tick {paused_tick}"
    ros.spin_until(lambda: paused and paused[-1].data)
    ros.spin_for(0.15)
    assert scene.tick == paused_tick
    assert scene.pause(False).message.startswith("running")
    ros.spin_until(lambda: not paused[-1].data)
    scene.until_tick(paused_tick + 3)
    assert scene.soil.run.scheduler.lost_time == 0.0


def test_responses_before_an_expected_machine_has_joined_name_no_tick(
    ros: Ros, tmp_path: Path
) -> None:
    path = tmp_path / "ground.npz"
    scene = Scene(ros, save_path=str(path))
    assert scene.pause().message == "paused before the first tick"
    assert scene.pause(False).message == "running before the first tick"
    assert scene.trigger("/soil/verify").message.startswith("before the first tick: columns")
    expected = f"terrain before the first tick written to {path}"
    assert scene.trigger("/soil/save").message == expected
    assert scene.tick < 0


def test_step_computes_one_tick(ros: Ros) -> None:
    scene = Scene(ros, **NO_MACHINES, paused=True)
    ros.spin_until(lambda: scene.tick == 0)
    for tick in (1, 2):
        response = scene.trigger("/sim/step")
        assert response.success
        assert response.message == f"tick {tick} completed"
        assert scene.tick == tick


def test_step_is_rejected_while_the_run_is_not_paused(ros: Ros) -> None:
    scene = Scene(ros, **NO_MACHINES)
    scene.until_tick(1)
    response = scene.trigger("/sim/step")
    assert not response.success
    assert "/sim/pause" in response.message


def test_step_is_rejected_before_the_run_begins(ros: Ros) -> None:
    response = Scene(ros, paused=True).trigger("/sim/step")
    assert not response.success
    assert "has not joined" in response.message


def request_steps(scene: Scene, count: int) -> list[Future]:
    """Request steps, and return their futures once the soil node has received all of them."""
    client = scene.ros.helper.create_client(Trigger, "/sim/step")
    scene.ros.spin_until(client.service_is_ready)
    steps = [client.call_async(Trigger.Request()) for _ in range(count)]
    scene.ros.spin_until(
        lambda: scene.soil.num_pending_steps + sum(s.done() for s in steps) == count
    )
    return steps


def test_steps_wait_for_a_late_machine(ros: Ros) -> None:
    scene = Scene(ros, paused=True)
    machine = scene.machine()
    ros.spin_until(lambda: scene.tick == 0)
    ros.executor.remove_node(machine)
    steps = request_steps(scene, 3)
    assert not steps[2].done()
    ros.executor.add_node(machine)
    ros.spin_until(lambda: all(step.done() for step in steps))
    assert [step.result().message for step in steps] == [f"tick {n} completed" for n in (1, 2, 3)]
    assert scene.tick == 3


def test_all_of_many_concurrent_steps_are_answered(ros: Ros) -> None:
    scene = Scene(ros, **NO_MACHINES, paused=True)
    ros.spin_until(lambda: scene.tick == 0)
    client = ros.helper.create_client(Trigger, "/sim/step")  # with the default QoS
    ros.spin_until(client.service_is_ready)
    steps = [client.call_async(Trigger.Request()) for _ in range(200)]
    ros.spin_until(lambda: all(step.done() for step in steps), what="200 responses")
    messages = [step.result().message for step in steps]
    assert messages == [f"tick {n} completed" for n in range(1, 201)]
    assert scene.tick == 200


def test_pending_step_fails_at_a_reset(ros: Ros) -> None:
    scene = Scene(ros, paused=True)
    machine = scene.machine()
    ros.spin_until(lambda: scene.tick == 0)
    ros.executor.remove_node(machine)
    steps = request_steps(scene, 3)
    assert scene.trigger("/sim/reset").success
    ros.spin_until(steps[2].done)
    assert not steps[2].result().success
    assert steps[2].result().message == "the run was reset"
    ros.executor.add_node(machine)


def test_reset_starts_the_next_run_on_the_initial_site(ros: Ros, tmp_path: Path) -> None:
    configs = ros.collect("/sim/config", String, qos.TRANSIENT_LOCAL)
    scene = excavating_scene(ros, tmp_path)
    endpoint = scene.soil.run.endpoint
    run_id, start = endpoint.exchange.run_id, scene.ledgers[0].start
    excavated = endpoint.soil.state_hash()
    response = scene.trigger("/sim/reset")
    assert response.success
    assert str(run_id + 1) in response.message
    endpoint = scene.soil.run.endpoint
    assert endpoint.exchange.run_id == run_id + 1
    ros.spin_until(lambda: parse_run_facts(configs[-1].data).run_id == run_id + 1)
    scene.until_tick(20)
    first = [ledger for ledger in scene.ledgers if ledger.tick == 0][-1]
    assert first.terrain == first.start == start
    assert endpoint.soil.total_mm3 == start
    assert endpoint.soil.state_hash() != excavated
    assert {ledger.imbalance for ledger in scene.ledgers} == {0}


def test_reset_keeps_the_run_paused(ros: Ros) -> None:
    scene = Scene(ros, **NO_MACHINES)
    scene.until_tick(3)
    scene.pause()
    scene.trigger("/sim/reset")
    ros.spin_until(lambda: scene.tick == 0)
    assert scene.soil.run.paused
    scene.step()
    assert scene.tick == 1


def test_verify_detects_a_modified_column(ros: Ros) -> None:
    scene = Scene(ros, **NO_MACHINES)
    scene.until_tick(2)
    response = scene.trigger("/soil/verify")
    assert response.success
    assert str(scene.soil.run.endpoint.soil.total_mm3) in response.message
    scene.soil.run.endpoint.soil.columns.firm[3, 3] -= 1
    assert not scene.trigger("/soil/verify").success


def test_save_writes_the_current_terrain(ros: Ros, tmp_path: Path) -> None:
    path = tmp_path / "new folder" / "ground.npz"
    scene = excavating_scene(ros, tmp_path, save_path=str(path))
    scene.pause()
    response = scene.trigger("/soil/save")
    assert response.success
    assert str(path) in response.message
    saved = load_terrain(path)
    assert saved.grid == Grid(65, 65, 0.4)
    assert saved.heights == pytest.approx(scene.soil.run.endpoint.soil.columns.height, abs=1e-6)
    assert saved.heights.min() < -0.01


def test_save_writes_soils_and_moisture(ros: Ros, tmp_path: Path) -> None:
    path = tmp_path / "ground.npz"
    scene = excavating_scene(
        ros, tmp_path, save_path=str(path), **layered_site_parameters(tmp_path)
    )
    scene.pause()
    response = scene.trigger("/soil/save")
    assert response.message.endswith(str(path))
    _, layers = load_terrain_with_layers(path)
    columns = scene.soil.run.endpoint.soil.columns
    assert np.array_equal(layers.soil, columns.top_soil)
    assert np.array_equal(layers.moisture, columns.top_moisture)


def test_save_reports_a_format_without_layers(ros: Ros, tmp_path: Path) -> None:
    path = tmp_path / "ground.asc"
    scene = Scene(ros, **NO_MACHINES, save_path=str(path))
    response = scene.trigger("/soil/save")
    assert response.success
    assert "heights only" in response.message
    assert load_terrain(path).grid == Grid(65, 65, 0.4)


@pytest.mark.parametrize("name", ["no/such/folder/ground.npz", "ground.jpeg"])
def test_save_reports_an_unwritable_file(ros: Ros, tmp_path: Path, name: str) -> None:
    scene = Scene(ros, **NO_MACHINES, save_path=str(tmp_path / name))
    response = scene.trigger("/soil/save")
    assert not response.success
    assert name in response.message
    scene.until_tick(1)


def test_release_is_rejected_without_absent_soil(ros: Ros) -> None:
    response = Scene(ros, **NO_MACHINES).trigger("/soil/release")
    assert not response.success
    assert "no machine" in response.message


def test_release_states_that_a_machine_is_not_silent_for_long_enough(ros: Ros) -> None:
    scene = Scene(ros, machine_timeout=100.0)
    machine = scene.machine()
    scene.until_tick(3)
    ros.remove(machine)
    ros.spin_until(lambda: scene.soil.run.endpoint.exchange.late, what="a tick without it")
    last_message_times = scene.soil.last_message_times()
    last_message_times[1] += 60.0  # it computes
    assert scene.trigger("/soil/release").message == "no machine has left soil behind"
    last_message_times[1] -= 61.0
    response = scene.trigger("/soil/release")
    assert not response.success
    assert "waits for machines 1, silent for less than machine_timeout (100 s)" in response.message
    scene.soil.set_parameters([Parameter("machine_timeout", value=0.1)])
    responses = []

    def is_released() -> bool:
        responses.append(scene.trigger("/soil/release"))
        return bool(responses[-1].success)

    ros.spin_until(is_released)
    assert responses[-1].message.startswith("the run continues without machines 1")
    assert "silent" not in responses[-1].message


def test_release_turns_absent_soil_into_terrain(ros: Ros, tmp_path: Path) -> None:
    scene = Scene(ros, sync="realtime")
    options = {"commands.command_timeout": 60.0, "machine": machine_file(tmp_path, ready_to_dig())}
    machine = scene.machine(**options)
    dig(scene, machine, lambda ledger: ledger.particles > 10**7)
    scene.leave(machine)
    ros.spin_until(lambda: scene.ledgers[-1].absent > 0)
    before = scene.ledgers[-1]
    assert before.absent >= 10**7
    assert scene.trigger("/soil/release").success
    ros.spin_until(lambda: scene.ledgers[-1].absent == 0)
    assert scene.ledgers[-1].terrain == before.start
    assert before.terrain + before.absent + before.in_flight == before.start
    assert {ledger.imbalance for ledger in scene.ledgers} == {0}
    assert scene.trigger("/soil/verify").success


def test_step_completes_a_release_in_lockstep_without_machines(ros: Ros, tmp_path: Path) -> None:
    scene = excavating_scene(ros, tmp_path)
    scene.leave(next(n for n in ros.executor.get_nodes() if isinstance(n, MachineNode)))
    scene.pause()
    assert scene.trigger("/soil/release").success
    scene.step()
    endpoint = scene.soil.run.endpoint
    assert endpoint.soil.total_mm3 == endpoint.exchange.ledger.start


def test_machine_can_rejoin_in_lockstep_after_a_release(ros: Ros, tmp_path: Path) -> None:
    scene = excavating_scene(ros, tmp_path)
    scene.leave(next(n for n in ros.executor.get_nodes() if isinstance(n, MachineNode)))
    assert scene.trigger("/soil/release").success  # no tick until a machine joins
    now = int(time.time())
    ros.spin_until(lambda: int(time.time()) > now, what="a new session_id")
    scene.machine(x=-5.0)
    scene.more_ticks(5)
    assert {ledger.imbalance for ledger in scene.ledgers} == {0}
