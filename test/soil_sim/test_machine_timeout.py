"""Going on without a machine that lockstep has waited for too long."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.node_scenes import Scene, dig, machine_file, ready_to_dig
from support.soil_scenes import bucket_sweep, flat_soil, make_deposit_requests

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


def join(side: SoilEndpoint, *sources: int) -> list[MachineExchange]:
    """Machines that have been welcomed."""
    machines = [MachineExchange(machine_id) for machine_id in sources]
    for machine in machines:
        machine.join()
        deliver(machine, side)
    assert side.advance() is not None
    for message in side.drain_outbox():
        for machine in machines:
            machine.receive(message)
    return machines


def deliver(machine: MachineExchange, side: SoilEndpoint) -> None:
    for message in machine.drain_outbox():
        side.receive(message)


def begun(*sources: int) -> tuple[SoilRun, list[MachineExchange]]:
    params = SoilNodeParams(sync="lockstep", expected_machines=sources, machine_timeout=1.0)
    run = SoilRun(Site(flat(flat_soil().grid)), SoilParams(), params, run_id=1)
    return run, join(run.endpoint, *sources)


def test_only_who_has_been_silent_for_too_long_is_given_up() -> None:
    run, machines = begun(1, 2)
    machines[1].send(STILL.copy(), NOTHING, pending_mm3=0, particles_mm3=0)
    deliver(machines[1], run.endpoint)
    heard = {1: 100.0, 2: 100.0}
    assert run.drop_silent_machines(100.9, heard) == ()
    assert run.advance(100.9) is None
    assert run.drop_silent_machines(101.1, heard) == (1,)
    assert run.endpoint.exchange.joined == (2,)
    assert run.advance(101.1) is not None


def test_a_tick_is_done_even_if_nobody_is_left_so_that_one_that_lives_comes_back() -> None:
    run, (machine,) = begun(1)
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


def test_what_swept_nowhere_last_is_released_where_it_swept_before() -> None:
    side = SoilEndpoint(flat_soil())
    (machine,) = join(side, 1)
    done = None
    for sweeps, leave in ((STILL.copy(), False), (STILL.copy(), True)):
        if leave:
            sweeps["x1"] = np.nan
        machine.send(sweeps, NOTHING, pending_mm3=1000, particles_mm3=0, leave=leave)
        deliver(machine, side)
        done = side.advance()
        for message in side.drain_outbox():
            machine.receive(message)
        machine.poll()
    assert done is not None
    assert done.step.rejected_tools
    assert done.ledger.absent == 1000
    assert side.release_absent_soil() == (1,)
    released = side.advance(wait=False)
    assert released is not None
    assert released.ledger.absent == 0
    assert released.ledger.terrain == done.ledger.terrain + 1000


def test_release_goes_on_without_a_machine_that_has_crashed_and_takes_over_what_it_held(
    ros: Ros, tmp_path: Path
) -> None:
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


def test_a_machine_that_was_given_up_and_lives_comes_back(ros: Ros) -> None:
    scene = Scene(ros, machine_timeout=0.2)
    machine = scene.machine()
    scene.until_tick(3)
    ros.executor.remove_node(machine)
    ros.spin_until(lambda: scene.trigger("/soil/release").success)
    assert scene.joined == ()
    ros.executor.add_node(machine)
    scene.more_ticks(5)
    assert scene.joined == (1,)


def test_one_that_waits_for_a_command_is_not_called_silent(
    ros: Ros, capfd: pytest.CaptureFixture[str]
) -> None:
    scene = Scene(ros, machine_timeout=0.5)
    machine = scene.machine(command_wait_period=1)
    ros.spin_until(
        lambda: scene.tick == 0 and machine.run is not None and machine.run.endpoint.is_ready
    )
    ros.spin_for(1.2)
    assert "silent" not in capfd.readouterr().err
    assert not scene.trigger("/soil/release").success
    assert scene.joined == (1,)
