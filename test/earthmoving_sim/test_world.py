"""World: soil and machines in one process: balance, terrain, invalid inputs, repeatability."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.machine_scenes import excavator, level_soil

from earthmoving_sim.world import World
from machine_sim.machine.arm_kinematics import arm_geometry, solve_arm_angles
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.contract.errors import ErrorCode, ExchangeError, ParameterError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.rows import ConversionKind

EXCAVATOR = excavator()


def drag(world: World, ticks: int) -> list[Ledger]:
    """Drag the lip of every machine through the ground; return the ledgers."""
    ledgers = []
    start = arm_geometry(EXCAVATOR).swing[2]
    for tick in range(ticks):
        fraction = tick / ticks
        reach, depth = 7.0 - 1.5 * fraction, 0.25 * math.sin(math.pi * fraction)
        target = solve_arm_angles(EXCAVATOR, reach, -start - depth + 0.05, 2.0 + 0.5 * fraction)
        for machine in world.machines.values():
            error = np.array(target) - machine.machine.joint_positions[1:]
            machine.command(np.array([0.0, *(5.0 * error)]), np.zeros(2))
        ledgers.append(world.step())
    return ledgers


def ready_to_dig(position: tuple[float, float] = (0.0, 0.0), **options: object) -> MachineSim:
    """Return a machine whose lip is just above the ground."""
    angles = solve_arm_angles(EXCAVATOR, 7.0, -arm_geometry(EXCAVATOR).swing[2] + 0.1, 2.0)
    spec = replace(EXCAVATOR, home=np.array([0.0, *angles]))
    soil = level_soil()
    placements = [Placement(spec, position)]
    return MachineSim(placements, soil.grid, soil.columns.height, **options)  # type: ignore[arg-type]


@pytest.fixture
def dug():
    world = World(level_soil(), {1: ready_to_dig()})
    ledgers = drag(world, 250)
    yield world, ledgers
    world.close()


def test_every_tick_of_a_dig_balances(dug) -> None:
    world, ledgers = dug
    assert {ledger.imbalance for ledger in ledgers} == {0}
    assert ledgers[-1].particles > 100_000_000
    assert any(ledger.in_flight > 0 for ledger in ledgers)
    assert any(ledger.pending > 0 for ledger in ledgers)
    assert world.soil.verify_volume()


def test_machine_follows_the_terrain_of_the_soil(dug) -> None:
    world, _ = dug
    for _ in range(300):
        world.step()
    assert world.soil.columns.height.min() < -0.1
    elevation = world.machines[1].ground.elevation
    assert elevation == pytest.approx(world.soil.columns.height, abs=1e-6)


def test_surface_is_that_of_the_last_tick_as_float32(dug) -> None:
    world, _ = dug
    before = world.surface.copy()
    drag(world, 50)
    after = world.soil.columns.height.astype(np.float32)
    assert np.array_equal(world.surface, after)
    assert not np.array_equal(before, after)


def test_released_soil_becomes_terrain(dug) -> None:
    world, _ = dug
    num_deposits = 0
    for _ in range(400):
        world.step()
        answers = world.answers[1].conversions
        num_deposits += int((answers["kind"] == ConversionKind.DEPOSIT).sum())
    assert num_deposits > 0
    assert world.soil.columns.loose.sum() > 0
    assert world.ledger.imbalance == 0


def test_machine_that_lost_1_mm3_is_noticed_at_once() -> None:
    world = World(level_soil(), {1: ready_to_dig()})
    machine = world.machines[1]
    original_apply = machine.apply

    def apply(conversions, *others, **kwargs) -> None:
        excavated = np.flatnonzero(conversions["kind"] == ConversionKind.EXCAVATE)
        tampered = conversions.copy()
        tampered["volume_mm3"][excavated[:1]] -= 1
        original_apply(tampered, *others, **kwargs)

    machine.apply = apply  # type: ignore[method-assign]
    with pytest.raises(ExchangeError, match="machine 1 reports") as error:
        drag(world, 120)
    assert error.value.code is ErrorCode.VOLUME_MISMATCH
    assert world.ledger.imbalance == 0
    world.close()


def test_runs_with_one_seed_end_in_equal_states() -> None:
    hashes = []
    for seed in (0, 0, 1):
        world = World(level_soil(), {1: ready_to_dig(seed=seed)})
        drag(world, 220)
        hashes.append((world.state_hash(), world.machines[1].state_hash()))
        world.close()
    assert hashes[0] == hashes[1]
    assert hashes[0][1] != hashes[2][1]


def test_two_machines_dig_the_same_terrain() -> None:
    machines = {1: ready_to_dig(position=(-6.0, 3.0)), 2: ready_to_dig(position=(-6.0, -3.0))}
    world = World(level_soil(), machines)
    ledgers = drag(world, 200)
    world.close()
    assert {ledger.imbalance for ledger in ledgers} == {0}
    assert all(machine.particles.count > 100 for machine in machines.values())


def test_invalid_sweeps_are_logged_and_cut_nothing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    world = World(level_soil(), {1: ready_to_dig()})
    machine = world.machines[1]
    original_step = machine.step

    def step():
        result = original_step()
        result.sweeps["x1"][3] = np.nan
        return result

    machine.step = step  # type: ignore[method-assign]
    ledgers = drag(world, 60)
    world.close()
    assert {ledger.terrain for ledger in ledgers} == {ledgers[0].start}
    assert "machine 1, tool 0" in caplog.text


@pytest.mark.parametrize("name", ["swell", "density", "cohesion"])
def test_machine_and_soil_must_agree_on_loose_soil(name) -> None:
    machine = ready_to_dig(soils=[LooseSoil(**{name: 1.25})])
    with pytest.raises(ParameterError, match=rf"{name}=1.25"):
        World(level_soil(), {1: machine})
    machine.close()


def test_machine_and_soil_must_have_the_same_order_of_soils() -> None:
    soil = level_soil(swell=0.2, additional_soils=("reference",))
    machine = ready_to_dig(soils=[kind.loose_soil for kind in reversed(soil.soil_types)])
    with pytest.raises(ParameterError):
        World(soil, {1: machine})
    machine.close()
