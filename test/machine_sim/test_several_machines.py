"""Several machines in one simulation: tool ids, excavated soil, collisions, bins."""

from dataclasses import replace

import numpy as np
import pytest
from support.machine_scenes import GRID, level_soil, load_shipped_machine, loose_soil_options

from earthmoving_sim.world import World
from machine_sim.machine import MachineError, arm_geometry, solve_arm_angles
from machine_sim.simulated_bin import BinSpec
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from machine_sim.tool_soil.capped_spring_damper import MAX_FORCE
from msg_bridge.contract.rows import (
    CONVERSION,
    FORCE,
    MAP_UPDATE,
    ConversionKind,
    SoilReaction,
    SweepAction,
    empty_rows,
)

EXCAVATOR, HEADER, DUMPER = (
    load_shipped_machine(name) for name in ("excavator", "road_header", "dumper")
)
NOTHING = (empty_rows(CONVERSION), empty_rows(MAP_UPDATE))
FLAT = np.zeros(GRID.shape)


@pytest.fixture
def simulate():
    made = []

    def make(*machines: Placement, **options: object) -> MachineSim:
        made.append(MachineSim(machines, GRID, FLAT, **options))
        return made[-1]

    yield make
    for sim in made:
        sim.close()


def run(sim: MachineSim, ticks: int) -> None:
    for _ in range(ticks):
        sim.step()
        sim.apply(*NOTHING)


def test_tool_ids_are_consecutive_over_machines(simulate) -> None:
    sim = simulate(Placement(EXCAVATOR, (-4.0, 0.0)), Placement(HEADER, (4.0, 0.0)))
    for rig in sim.simulated_machines:
        rig.machine.command(np.zeros(len(rig.machine.spec.joints)), [0.5, 0.5])
    run(sim, 20)
    sweeps = sim.step().sweeps
    assert np.unique(sweeps["tool"]).tolist() == [0, 1, 2, 3, 4, 5]
    tools = [sweeps[sweeps["tool"] == k] for k in range(6)]
    assert [rows.size for rows in tools] == [14, 4, 4, 34, 4, 4]
    assert (tools[3]["action"] == SweepAction.COMPACT).all()  # its head is not driven


def test_spinning_head_mills(simulate) -> None:
    sim = simulate(Placement(HEADER))
    sim.machine.command({"head": 5.0}, [0.0, 0.0])
    run(sim, 100)
    sweeps = sim.step().sweeps
    assert (sweeps["action"][:34] == SweepAction.MILL).all()
    assert (sweeps["work"][:34] > 500.0).all()
    assert (sweeps["work"][34:] == 0.0).all()
    assert sim.machine.joint_velocities[2] == pytest.approx(5.0, rel=0.01)


def test_excavated_soil_is_credited_to_the_nearest_tool(simulate) -> None:
    sim = simulate(Placement(EXCAVATOR, (-6.0, 0.0)), Placement(HEADER, (6.0, 0.0)))
    works = [work for rig in sim.simulated_machines for work in rig.couplings.values()]
    rows = empty_rows(CONVERSION, 2)
    rows["kind"], rows["volume_mm3"] = ConversionKind.EXCAVATE, [100, 200]
    for k, work in enumerate(works):
        rows["x"][k], rows["y"][k], rows["z"][k] = work.tool.pose[1]
        rows["col"][k] = k
    sim.apply(rows, NOTHING[1])
    assert [work.pending.total_mm3 for work in works] == [100, 200]
    assert sim.pending_mm3 == 300


def test_distance_to_a_tool_is_that_of_its_nearest_key_point(simulate) -> None:
    sim = simulate(Placement(EXCAVATOR, (-4.0, 0.0)), Placement(EXCAVATOR, (-4.0, 8.0)))
    first = sim.simulated_machines[0].couplings["bucket"]
    rotation, pin = first.tool.pose
    rows = empty_rows(CONVERSION, 1)
    rows["kind"], rows["volume_mm3"] = ConversionKind.EXCAVATE, 100
    rows["x"], rows["y"], rows["z"] = pin + rotation @ [1.45, 0.6, 0.0]
    sim.apply(rows, NOTHING[1])
    assert first.pending.total_mm3 == 100


@pytest.mark.parametrize("order", [[0, 1, 2], [0, 2, 1]], ids=["together", "apart"])
def test_each_tool_takes_its_own_force_rows(simulate, order: list[int]) -> None:
    sim = simulate(Placement(EXCAVATOR, (-4.0, 0.0)), Placement(EXCAVATOR, (-4.0, 8.0)))
    first, second = (each.couplings["bucket"] for each in sim.simulated_machines)
    forces = empty_rows(FORCE, 3)
    forces["tool"] = first.tool_id, first.tool_id, second.tool_id
    forces["reaction"] = SoilReaction.CUT, SoilReaction.BEARING, SoilReaction.CUT
    forces["fz"] = 1e3, 2e3, 4e3
    sim.apply(*NOTHING, forces[order])
    resistances = [first.resistance, second.resistance]
    assert [each.spring_dampers[:, MAX_FORCE].tolist() for each in resistances] == [
        [1e3, 2e3],
        [4e3, 0.0],
    ]


def test_overlapping_objects_are_rejected(simulate) -> None:
    with pytest.raises(MachineError, match=r"dumper at \(0\.0, 0\.0\) m and the dumper at"):
        simulate(Placement(DUMPER), Placement(DUMPER, (0.5, 0.0)))
    with pytest.raises(MachineError, match=r"the bin at .* overlap"):
        simulate(Placement(EXCAVATOR), bins=[BinSpec((0.0, 0.0))])


def test_machines_collide(simulate) -> None:
    sim = simulate(Placement(DUMPER, (0.0, 0.0)), Placement(DUMPER, (6.0, 0.0), np.pi))
    for rig in sim.simulated_machines:
        rig.machine.command([0.0], [1.0, 1.0])
    run(sim, 400)
    gap = (
        sim.simulated_machines[1].machine.base_pose[0][0]
        - sim.simulated_machines[0].machine.base_pose[0][0]
    )
    assert 3.5 < gap < 6.0  # their frames and cabs meet; unhindered they would have met and gone by


def test_command_moves_only_its_machine(simulate) -> None:
    sim = simulate(Placement(EXCAVATOR, (-5.0, 0.0)), Placement(DUMPER, (5.0, 0.0)))
    sim.simulated_machines[1].machine.command({"bed": -0.2}, [0.5, 0.5])
    run(sim, 150)
    first, second = (rig.machine for rig in sim.simulated_machines)
    assert np.linalg.norm(first.base_pose[0][:2] - [-5.0, 0.0]) < 0.02
    assert second.base_pose[0][0] > 5.4
    assert second.joint_positions[0] < -0.15


def test_soil_in_a_bed_is_payload_and_moves_with_it(simulate) -> None:
    sim = simulate(Placement(DUMPER))
    machine, rig = sim.machine, sim.simulated_machines[0]
    rotation, origin = machine.tool.pose
    rng = np.random.default_rng(0)
    local = rng.uniform((0.4, -0.9, 0.2), (3.0, 0.9, 0.9), (150, 3))
    sim.particles.add(local @ rotation.T + origin, np.zeros_like(local), 4_000_000)
    run(sim, 150)
    assert rig.payload.bank_m3 == pytest.approx(0.6)
    assert rig.payload.mass_kg == pytest.approx(960.0)
    machine.command([0.0], [1.0, 1.0])
    run(sim, 200)
    machine.command([0.0], [0.0, 0.0])
    run(sim, 50)
    assert machine.base_pose[0][0] > 1.5
    assert rig.payload.bank_m3 == pytest.approx(0.6)
    machine.command([-0.2], [0.0, 0.0])
    for _ in range(700):
        step = sim.step()
        answers = empty_rows(CONVERSION, step.deposit_requests.size)
        answers["kind"], answers["particle_id"] = (
            ConversionKind.DEPOSIT,
            step.deposit_requests["particle_id"],
        )
        sim.apply(answers, NOTHING[1])
    assert rig.payload.bank_m3 < 0.01


def test_bin_collects_soil_and_stops_a_machine(simulate) -> None:
    sim = simulate(Placement(DUMPER, (-6.0, 0.0)), bins=[BinSpec((0.0, 0.0), np.pi / 2)])
    rng = np.random.default_rng(0)
    drop = rng.uniform((-0.9, -1.6, 0.2), (0.9, 1.6, 1.2), (200, 3))
    aside = [[4.0, 4.0, 0.3]]
    sim.particles.add([*drop, *aside], np.zeros((201, 3)), 4_000_000)
    sim.machine.command([0.0], [1.0, 1.0])
    run(sim, 700)
    (hopper,) = sim.bins
    assert hopper.payload.bank_m3 == pytest.approx(0.8)
    assert hopper.payload.loose_m3 == pytest.approx(hopper.payload.fill * 19.4, rel=0.2)
    assert sim.machine.base_pose[0][0] < -3.0  # its cab touches the wall of the bin


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        (lambda: BinSpec((0.0, 0.0), length=0.0), "sizes above 0 m"),
        (lambda: BinSpec((np.nan, 0.0)), "finite numbers"),
        (lambda: BinSpec((999.0, 0.0)), "off the map: place the bin on it"),
    ],
)
def test_invalid_bins_are_rejected(simulate, spec, words) -> None:
    with pytest.raises(MachineError, match=words):
        simulate(Placement(DUMPER), bins=[spec()])


def test_machine_without_joints_and_tools_drives(simulate) -> None:
    bare = replace(DUMPER, links={"base": DUMPER.links["base"]}, joints={}, cylinders={}, tools={})
    sim = simulate(Placement(replace(bare, home=np.zeros(0))))
    sim.machine.command([], [1.0, 1.0])
    run(sim, 100)
    assert sim.machine.base_pose[0][0] > 0.5
    assert sim.payload.mass_kg == 0.0
    with pytest.raises(MachineError, match="give one with `tools`"):
        _ = sim.tool_coupling


def test_simulation_needs_a_machine(simulate) -> None:
    with pytest.raises(MachineError, match="give one placement or more"):
        simulate()


def test_excavator_and_road_header_dig_and_the_volume_balances() -> None:
    soil = level_soil()
    angles = solve_arm_angles(EXCAVATOR, 7.0, 0.1 - arm_geometry(EXCAVATOR).swing[2], 2.0)
    digger = replace(EXCAVATOR, home=np.array([0.0, *angles]))
    header = replace(HEADER, home=np.array([0.0, 0.1, 0.0]))
    sim = MachineSim(
        [Placement(digger, (-9.0, -4.0)), Placement(header, (-4.0, 5.0))],
        GRID,
        soil.columns.height,
        **loose_soil_options(soil),
    )
    world = World(soil, {1: sim})
    before = soil.total_mm3
    imbalances, milled = set(), []
    for tick in range(300):
        down = 0.2 if tick < 150 else 0.0
        sim.simulated_machines[0].machine.command([0.0, down, 0.3, 0.3], [0.0, 0.0])
        sim.simulated_machines[1].machine.command([0.0, 0.25, 5.0], [0.0, 0.0])
        ledger = world.step()
        imbalances.add(ledger.imbalance)
        milled.append(sim.simulated_machines[1].machine.joint_efforts[2])
    taken = before - soil.total_mm3
    world.close()
    assert imbalances == {0}
    assert taken > 300_000_000
    assert max(milled) > 2e3  # the soil resists the head
