import math
from dataclasses import replace

import numpy as np
import pytest
from support.machine_scenes import excavator, level_soil

from earthmoving_sim.world import World
from machine_sim.machine.arm_kinematics import arm_geometry, solve_arm_angles
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.rows import ConversionKind

DESCRIPTION = excavator()


def drag(world: World, ticks: int) -> list[Ledger]:
    """Every machine puts its lip in the ground before it and draws it in."""
    ledgers = []
    start = arm_geometry(DESCRIPTION).swing[2]
    for tick in range(ticks):
        part = tick / ticks
        reach, depth = 7.0 - 1.5 * part, 0.25 * math.sin(math.pi * part)
        wanted = solve_arm_angles(DESCRIPTION, reach, -start - depth + 0.05, 2.0 + 0.5 * part)
        for machine in world.machines.values():
            error = np.array(wanted) - machine.machine.joint_positions[1:]
            machine.command(np.array([0.0, *(5.0 * error)]), np.zeros(2))
        ledgers.append(world.step())
    return ledgers


def ready(position: tuple[float, float] = (0.0, 0.0), **options: object) -> MachineSim:
    """A machine whose lip is just above the ground already."""
    angles = solve_arm_angles(DESCRIPTION, 7.0, -arm_geometry(DESCRIPTION).swing[2] + 0.1, 2.0)
    spec = replace(DESCRIPTION, home=np.array([0.0, *angles]))
    soil = level_soil()
    placements = [Placement(spec, position)]
    return MachineSim(placements, soil.grid, soil.columns.height, **options)  # type: ignore[arg-type]


@pytest.fixture
def dug():
    world = World(level_soil(), {1: ready()})
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


def test_the_machine_feels_the_terrain_the_soil_has(dug) -> None:
    world, _ = dug
    for _ in range(300):
        world.step()
    assert world.soil.columns.height.min() < -0.1
    felt = world.machines[1].ground.elevation
    assert felt == pytest.approx(world.soil.columns.height, abs=1e-6)


def test_the_surface_is_that_of_the_last_tick_to_the_bits_of_messages(dug) -> None:
    world, _ = dug
    before = world.surface
    assert world.surface is before
    drag(world, 50)
    after = world.soil.columns.height.astype(np.float32)
    assert np.array_equal(world.surface, after)
    assert not np.array_equal(before, after)


def test_soil_that_lands_is_terrain_again(dug) -> None:
    world, _ = dug
    landed = 0
    for _ in range(400):
        world.step()
        answers = world.answers[1].conversions
        landed += int((answers["kind"] == ConversionKind.DEPOSIT).sum())
    assert landed > 0
    assert world.soil.columns.loose.sum() > 0
    assert world.ledger.imbalance == 0


def test_one_tampered_parcel_shows_in_the_ledger() -> None:
    world = World(level_soil(), {1: ready()})
    machine = world.machines[1]
    honest = machine.apply
    tampered = []

    def apply(conversions, *others, **kwargs) -> None:
        excavated = np.flatnonzero(conversions["kind"] == ConversionKind.EXCAVATE)
        if excavated.size and not tampered:
            conversions["volume_mm3"][excavated[0]] -= 1
            tampered.append(True)
        honest(conversions, *others, **kwargs)

    machine.apply = apply  # type: ignore[method-assign]
    ledgers = drag(world, 120)
    world.close()
    assert tampered
    assert ledgers[0].imbalance == 0
    assert ledgers[-1].imbalance == -1


def test_equal_runs_end_in_equal_states() -> None:
    hashes = []
    for seed in (0, 0, 1):
        world = World(level_soil(), {1: ready(seed=seed)})
        drag(world, 220)
        hashes.append((world.state_hash(), world.machines[1].state_hash()))
        world.close()
    assert hashes[0] == hashes[1]
    assert hashes[0][1] != hashes[2][1]


def test_two_machines_dig_the_same_terrain() -> None:
    machines = {1: ready(position=(-6.0, 3.0)), 2: ready(position=(-6.0, -3.0))}
    world = World(level_soil(), machines)
    ledgers = drag(world, 200)
    world.close()
    assert {ledger.imbalance for ledger in ledgers} == {0}
    assert all(machine.particles.count > 100 for machine in machines.values())


def test_a_tool_that_cannot_be_believed_is_said_loudly_and_moves_nothing(
    caplog: pytest.LogCaptureFixture,
) -> None:
    world = World(level_soil(), {1: ready()})
    machine = world.machines[1]
    honest = machine.step

    def step():
        moved = honest()
        moved.sweeps["x1"][3] = np.nan
        return moved

    machine.step = step  # type: ignore[method-assign]
    ledgers = drag(world, 60)
    world.close()
    assert {ledger.terrain for ledger in ledgers} == {ledgers[0].start}
    assert "machine 1, tool 0" in caplog.text


@pytest.mark.parametrize("name", ["swell", "density", "cohesion"])
def test_machine_and_soil_must_agree_on_loose_soil(name) -> None:
    machine = ready(soils=[LooseSoil(**{name: 1.25})])
    with pytest.raises(ParameterError, match=rf"{name}=1.25.*, the terrain has"):
        World(level_soil(), {1: machine})
    machine.close()


def test_machine_and_soil_must_agree_on_which_soil_swells_how() -> None:
    soil = level_soil(swell=0.2, additional_soils=("reference",))
    machine = ready(soils=[kind.loose_soil for kind in reversed(soil.soil_types)])
    with pytest.raises(ParameterError, match="knows the soils"):
        World(soil, {1: machine})
    machine.close()
