"""In lockstep, a machine that is silent for `machine_timeout` is dropped, and may rejoin."""

from __future__ import annotations

from pathlib import Path

import pytest
from support.node_scenes import Scene, dig, machine_file, ready_to_dig
from support.soil_scenes import bucket_sweep, flat_soil, make_deposit_requests

from machine_sim.node import run_membership
from msg_bridge.exchange.machine_exchange import MachineExchange
from msg_bridge.testing.ros_context import Ros
from soil_sim.endpoint import SoilEndpoint
from soil_sim.node.params import SoilNodeParams
from soil_sim.node.soil_run import SoilRun
from soil_sim.site.site import Site
from soil_sim.soils.params import SoilParams
from soil_sim.terrain import flat

STILL = bucket_sweep((0, 0, 1), (0, 0, 1))
NOTHING = make_deposit_requests([], [], 0)


def join(endpoint: SoilEndpoint, *machine_ids: int) -> list[MachineExchange]:
    """Return machines that have joined."""
    machines = [MachineExchange(machine_id) for machine_id in machine_ids]
    for machine in machines:
        machine.join()
        deliver(machine, endpoint)
    assert endpoint.advance() is not None
    for message in endpoint.drain_outbox():
        for machine in machines:
            machine.receive(message)
    return machines


def deliver(machine: MachineExchange, endpoint: SoilEndpoint) -> None:
    """Deliver what a machine has sent to the soil."""
    for message in machine.drain_outbox():
        endpoint.receive(message)


def lockstep_run(*machine_ids: int) -> tuple[SoilRun, list[MachineExchange]]:
    """Return a lockstep run with machines that have joined, and a timeout of 1 s."""
    params = SoilNodeParams(sync="lockstep", expected_machines=machine_ids, machine_timeout=1.0)
    run = SoilRun(Site(flat(flat_soil().grid)), SoilParams(), params, run_id=1)
    return run, join(run.endpoint, *machine_ids)


def test_only_machine_silent_for_the_timeout_is_dropped() -> None:
    run, machines = lockstep_run(1, 2)
    machines[1].send(STILL.copy(), NOTHING, pending_mm3=0, particles_mm3=0)
    deliver(machines[1], run.endpoint)
    last_message_times = {1: 100.0, 2: 100.0}
    assert run.drop_silent_machines(100.9, last_message_times) == ()
    assert run.advance(100.9) is None
    assert run.drop_silent_machines(101.1, last_message_times) == (1,)
    assert run.endpoint.exchange.joined == (2,)
    assert run.advance(101.1) is not None


def test_dropped_machine_can_rejoin_a_run_without_machines() -> None:
    run, (machine,) = lockstep_run(1)
    assert run.drop_silent_machines(105.0, {1: 100.0}) == (1,)
    assert run.advance(105.0) is not None
    assert run.advance(105.0) is None
    for message in run.endpoint.drain_outbox():
        machine.receive(message)
    assert machine.dropped
    machine.join()
    deliver(machine, run.endpoint)
    assert run.advance(105.0) is not None
    assert run.endpoint.exchange.joined == (1,)


def test_release_drops_a_crashed_machine_and_deposits_its_soil(ros: Ros, tmp_path: Path) -> None:
    scene = Scene(ros, machine_timeout=0.3, expected_machines=[1, 2])
    file = machine_file(tmp_path, ready_to_dig())
    digger = scene.machine(machine=file, **{"commands.command_timeout": 60.0})
    scene.machine("/excavator_2", machine_id=2, x=8.0, y=8.0)
    dig(scene, digger, lambda ledger: ledger.particles + ledger.pending > 5 * 10**6)
    ros.remove(digger)
    ros.spin_until(lambda: scene.trigger("/soil/release").success)
    scene.more_ticks(5)
    ledger = scene.ledgers[-1]
    assert scene.joined == (2,)
    assert (ledger.absent, ledger.pending, ledger.particles, ledger.in_flight) == (0, 0, 0, 0)
    assert ledger.imbalance == 0
    scene.machine(machine=file)
    ros.spin_until(lambda: scene.joined == (1, 2))
    scene.more_ticks(5)
    assert scene.ledgers[-1].imbalance == 0


def test_dropped_machine_that_is_alive_rejoins(ros: Ros) -> None:
    scene = Scene(ros, machine_timeout=0.2)
    machine = scene.machine()
    scene.until_tick(3)
    ros.executor.remove_node(machine)
    ros.spin_until(lambda: scene.trigger("/soil/release").success)
    assert scene.joined == ()
    ros.executor.add_node(machine)
    scene.more_ticks(5)
    assert scene.joined == (1,)


def test_machine_that_waits_for_a_command_is_not_silent(ros: Ros) -> None:
    scene = Scene(ros, machine_timeout=0.5)
    machine = scene.machine(command_wait_period=1)
    ros.spin_until(
        lambda: scene.tick == 0 and machine.run is not None and machine.run.endpoint.is_ready
    )
    ros.spin_for(1.2)
    assert not scene.trigger("/soil/release").success
    assert scene.joined == (1,)


def test_machine_whose_soil_was_released_joins_again_without_it(
    ros: Ros, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run_membership, "_REJOIN_PERIOD", 0.1)
    scene = Scene(ros, machine_timeout=0.3)
    file = machine_file(tmp_path, ready_to_dig())
    digger = scene.machine(machine=file, **{"commands.command_timeout": 60.0})
    dig(scene, digger, lambda ledger: ledger.particles + ledger.pending > 5 * 10**6)
    ros.executor.remove_node(digger)  # it stands still, with its soil
    ros.spin_until(lambda: scene.trigger("/soil/release").success)
    ros.spin_until(lambda: scene.joined == ())
    ros.executor.add_node(digger)
    ros.spin_until(lambda: scene.joined == (1,), what="the machine to have joined again")
    scene.more_ticks(5)
    ledger = scene.ledgers[-1]
    assert (ledger.imbalance, ledger.absent) == (0, 0)
    assert digger.run is not None
    assert digger.diagnostics.report().values["times_soil_discarded"] == "1"
