import gc
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pybullet
import pytest
from support.machine_scenes import GRID, excavator, load_shipped_machine, machine_on_level_ground

from machine_sim.dem import ParticleParams
from machine_sim.machine import MachineError, TrackedMachine
from machine_sim.params import MachineSimParams
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.contract.rows import CONVERSION, MAP_UPDATE, ConversionKind, empty_rows

NOTHING = (empty_rows(CONVERSION), empty_rows(MAP_UPDATE))


@pytest.fixture
def machine():
    made = machine_on_level_ground()
    yield made
    made.close()


def add_particles(machine: MachineSim, count: int) -> None:
    """Add particles on the ground beside the machine."""
    x = np.column_stack([np.linspace(4, 6, count), np.full(count, 5.0), np.full(count, 0.04)])
    machine.particles.add(x, np.zeros_like(x), 500_000)


def step_until_deposit_request(machine: MachineSim):
    """Step until a deposit is requested, and return that tick."""
    for _ in range(100):
        step = machine.step()
        if step.deposit_requests.size:
            return step
        machine.apply(*NOTHING)
    raise AssertionError("no deposit request within a second")


def test_deposit_of_settled_soil_is_requested_once_and_kept_until_answered(
    machine: MachineSim,
) -> None:
    add_particles(machine, 3)
    step = step_until_deposit_request(machine)
    assert step.deposit_requests["volume_mm3"].tolist() == [500_000] * 3
    assert step.particles_mm3 == 1_500_000
    machine.apply(*NOTHING)
    assert machine.step().deposit_requests.size == 0
    assert machine.particles.total_volume_mm3 == 1_500_000


def test_accepted_deposit_removes_the_particle(machine: MachineSim) -> None:
    add_particles(machine, 3)
    step = step_until_deposit_request(machine)
    answer = empty_rows(CONVERSION, 2)
    answer["particle_id"] = step.deposit_requests["particle_id"][:2]
    answer["kind"], answer["volume_mm3"] = [ConversionKind.DEPOSIT, ConversionKind.OUTSIDE], 500_000
    machine.apply(answer, empty_rows(MAP_UPDATE))
    assert machine.pending_mm3 == 0, "only excavated soil becomes pending"
    assert machine.particles.ids.tolist() == [step.deposit_requests["particle_id"][2]]


def test_rejected_deposit_releases_the_particle_which_is_requested_again(
    machine: MachineSim,
) -> None:
    add_particles(machine, 1)
    step = step_until_deposit_request(machine)
    answer = empty_rows(CONVERSION, 1)
    answer["particle_id"], answer["kind"] = (
        step.deposit_requests["particle_id"],
        ConversionKind.REJECT,
    )
    machine.apply(answer, empty_rows(MAP_UPDATE))
    again = step_until_deposit_request(machine)
    assert again.deposit_requests["particle_id"] == step.deposit_requests["particle_id"]


def test_deposit_of_soil_off_the_map_is_requested(machine: MachineSim) -> None:
    machine.particles.add([[99.0, 0.0, 1.0]], [[0.0, 0.0, 0.0]], 500_000)
    assert machine.step().deposit_requests["x"][0] == pytest.approx(99.0, abs=0.1)


def test_payload_loads_the_machine() -> None:
    boom = []
    for loaded in (True, False):
        machine = machine_on_level_ground(params=MachineSimParams(payload_coupling=loaded))
        pose = machine.machine.tool.pose
        rng = np.random.default_rng(0)
        local = np.column_stack(
            [rng.uniform(0.4, 1.1, 900), rng.uniform(-0.4, 0.4, 900), rng.uniform(0.1, 0.5, 900)]
        )
        machine.particles.add(local @ pose[0].T + pose[1], np.zeros_like(local), 500_000)
        for _ in range(150):
            machine.step()
            machine.apply(*NOTHING)
        boom.append(abs(machine.machine.joint_efforts[1]))
        machine.close()
    assert boom[0] > boom[1] + 20e3  # 0.8 t at more than 2.5 m


def test_efforts_are_the_mean_over_the_steps_of_a_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    steps: list[tuple[np.ndarray, np.ndarray]] = []
    after_step = TrackedMachine.after_step

    def recorded(self: TrackedMachine) -> None:
        after_step(self)
        steps.append((self.joint_efforts, self.tracks.drive_forces.copy()))

    monkeypatch.setattr(TrackedMachine, "after_step", recorded)
    machine = machine_on_level_ground(params=MachineSimParams(steps_per_tick=4))
    simulated = machine.simulated_machines[0]
    machine.command(np.full(4, 0.3), np.full(2, 0.5))
    for _ in range(20):
        steps.clear()
        machine.step()
        machine.apply(*NOTHING)
    joints, drives = (np.array(each) for each in zip(*steps, strict=True))
    assert joints.shape == (4, 4)
    assert np.ptp(joints, axis=0).max() > 100.0, "the steps differ"
    np.testing.assert_allclose(simulated.joint_efforts, joints.mean(axis=0))
    np.testing.assert_allclose(simulated.drive_forces, drives.mean(axis=0))
    linkage = machine.machine.spec.cylinders["boom"].linkage
    _, lever_arm = linkage.length_and_lever_arm(machine.machine.joint_positions[1])
    force = simulated.joint_efforts[1] / lever_arm
    assert simulated.cylinders["boom"].force == pytest.approx(force)
    machine.close()


def test_payload_is_the_soil_in_the_bucket(machine: MachineSim) -> None:
    assert machine.payload.fill == 0.0
    rotation, origin = machine.machine.tool.pose
    local = np.array([[0.7, 0.0, 0.3], [0.8, 0.2, 0.2], [5.0, 0.0, 0.0]])
    machine.particles.add(local @ rotation.T + origin, np.zeros((3, 3)), 500_000)
    machine.step()
    payload = machine.payload
    assert payload.bank_m3 == pytest.approx(1e-3)
    assert payload.loose_m3 == pytest.approx(1e-3, rel=1e-6)
    assert payload.mass_kg == pytest.approx(1.6)


def test_invalid_command_changes_nothing(machine: MachineSim) -> None:
    with pytest.raises(MachineError):
        machine.command(np.array([np.nan, 0, 0, 0]), np.zeros(2))
    before = machine.machine.joint_positions
    for _ in range(20):
        machine.step()
        machine.apply(*NOTHING)
    assert machine.machine.joint_positions == pytest.approx(before, abs=1e-3)


def test_every_tick_has_sweeps_of_all_key_points(machine: MachineSim) -> None:
    for _ in range(100):  # until it stands: tracks at rest have no sweeps
        first = machine.step().sweeps
        machine.apply(*NOTHING)
    second = machine.step().sweeps
    assert first.size == second.size == 14
    assert np.array_equal(first["x1"], second["x0"])


def test_state_hash_is_equal_for_equal_runs_only() -> None:
    hashes = []
    for speed in (0.3, 0.3, 0.31):
        machine = machine_on_level_ground()
        add_particles(machine, 20)
        machine.command(np.array([speed, -0.1, 0.2, 0.1]), np.array([0.5, 0.5]))
        for _ in range(50):
            machine.step()
            machine.apply(*NOTHING)
        hashes.append(machine.state_hash())
        machine.close()
    assert hashes[0] == hashes[1]
    assert hashes[0] != hashes[2]


def test_machine_continues_with_other_parameters(machine: MachineSim) -> None:
    add_particles(machine, 3)
    excavated = empty_rows(CONVERSION, 1)
    excavated["kind"], excavated["volume_mm3"] = ConversionKind.EXCAVATE, 1000
    machine.credit_excavated_soil(excavated, 0)  # less than a particle
    machine.command(np.array([0.4, 0.0, 0.0, 0.0]), np.ones(2))
    step_until_deposit_request(machine)
    excavated["volume_mm3"] = 123_456
    machine.credit_excavated_soil(excavated, 0)
    spec = excavator()
    links = {**spec.links, "upper": replace(spec.links["upper"], mass=15_000.0)}
    params = ParticleParams(nominal_volume=200_000)
    heavier = machine_on_level_ground(replace(spec, links=links), particle_params=params)
    heavier.continue_from(machine)
    assert heavier.tick == machine.tick
    assert heavier.pending_mm3 == 124_456
    for name in ("ids", "positions", "volumes_mm3", "frozen_ids"):
        assert np.array_equal(getattr(heavier.particles, name), getattr(machine.particles, name))
    now, before = heavier.machine, machine.machine
    np.testing.assert_allclose(now.joint_positions, before.joint_positions)
    np.testing.assert_allclose(now.joint_velocities, before.joint_velocities)
    np.testing.assert_allclose(now.base_pose[0], before.base_pose[0], atol=1e-9)
    np.testing.assert_allclose(now.base_velocity[0], before.base_velocity[0], atol=1e-9)
    swing = now.joint_positions[0]
    for sim in (heavier, machine):
        for _ in range(20):
            sim.step()
    assert now.joint_positions[0] > swing + 0.01, "the command is still in force"
    np.testing.assert_allclose(now.base_pose[0], before.base_pose[0], atol=0.05)
    assert heavier.particles.add([[0.0, 5.0, 1.0]], [[0.0, 0.0, 0.0]], 500_000) > 3
    heavier.close()


def test_machine_does_not_continue_as_one_with_other_tools(machine: MachineSim) -> None:
    other = machine_on_level_ground(load_shipped_machine("dumper"))
    with pytest.raises(MachineError, match="give a machine with these tools"):
        other.continue_from(machine)
    other.close()


@pytest.mark.parametrize("x", [0.0, 999.0])
def test_physics_engine_is_released_with_the_simulation(x: float) -> None:
    """Also of one that cannot be made: no machine stands off the map."""
    gc.collect()  # simulations of tests before
    before = num_physics_clients()
    with suppress(MachineError):
        sim = MachineSim([Placement(excavator(), (x, 0.0))], GRID, np.zeros(GRID.shape))
        assert num_physics_clients() == before + 1
        del sim
    gc.collect()
    assert num_physics_clients() == before


def num_physics_clients() -> int:
    return sum(pybullet.isConnected(client) for client in range(100))
