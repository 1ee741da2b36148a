"""Record the state hashes of a set of runs, and compare them after a refactoring.

Each scene runs soil and machines in one process and takes the state hashes of both at regular
ticks. A refactoring must leave all of them unchanged; the hashes are the same only on one family
of processors and one set of package versions, so they are recorded on the machine at hand:

    python -m benchmarks.state_hashes record hashes.json     # before the change
    python -m benchmarks.state_hashes compare hashes.json    # after it; exit code 1 if any differ

`--scene NAME` (repeatable) selects scenes; `list` prints their names.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from benchmarks.random_digging import RandomOperator
from dig_operator import BehaviourParams, DigTask, DigTaskParams, FaceCuttingParams, FaceCuttingTask
from earthmoving_sim.operated_machine import OperatedMachine
from earthmoving_sim.run_config import load_run_config
from earthmoving_sim.single_process_dig import SingleProcessDig
from earthmoving_sim.world import World
from machine_sim.dem import ParticleParams
from machine_sim.machine import MachineSpec, load_machine_spec
from machine_sim.machine.arm_kinematics import arm_geometry, solve_arm_angles
from machine_sim.params import MachineSimParams
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import DEPOSIT_REQUEST, SWEEP, empty_rows
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

Hashes = list[str]
Scene = Callable[[], Hashes]

STRIDE = 100
"""Ticks between hashes."""


def machine_file(name: str) -> MachineSpec:
    """Return a shipped machine."""
    return load_machine_spec(find_config(f"machines/{name}.yaml"))


def machines_on(
    soil: Soil, placements: list[Placement], params: MachineSimParams, nominal_mm3: int
) -> MachineSim:
    """Set machines on a terrain."""
    return MachineSim(
        placements,
        soil.grid,
        soil.columns.height,
        params=params,
        soils=soil.loose_soils,
        soil=soil.columns.top_soil,
        moisture=soil.columns.top_moisture,
        particle_params=ParticleParams(nominal_volume=nominal_mm3),
    )


class HashedWorld(World):
    """A world that takes its hashes every `STRIDE` ticks.

    Attributes:
        hashes: of soil and machines together, one for each stride.
    """

    def __init__(self, soil: Soil, machines: Mapping[int, MachineSim]) -> None:
        self.hashes: Hashes = []
        super().__init__(soil, machines)

    def step(self):  # type: ignore[no-untyped-def]
        ledger = super().step()
        if ledger.imbalance:
            raise AssertionError(f"imbalance {ledger.imbalance} mm3 at tick {ledger.tick}")
        if self.tick % STRIDE == 0:
            self.hashes.append(world_hash(self))
        return ledger


def world_hash(world: World) -> str:
    """SHA-256 [hex] over the state hashes of the soil and of all machines."""
    parts = [world.state_hash(), *(machine.state_hash() for machine in world.machines.values())]
    return hashlib.sha256(" ".join(parts).encode()).hexdigest()


def operated(
    soil: Soil, sim: MachineSim, operators: list[DigTask | FaceCuttingTask], seconds: float
) -> Hashes:
    """Run machines with scripted operators."""
    world, tick = HashedWorld(soil, {1: sim}), sim.params.tick_period
    pairs = zip(
        sim.simulated_machines, operators, strict=False
    )  # machines beyond the operators stand still
    driven = [OperatedMachine(world, rig, each, tick) for rig, each in pairs]
    while world.tick * tick < seconds:
        for each in driven:
            each.observe_and_command(2 * tick)
        for _ in range(2):
            world.step()
    world.close()
    return world.hashes


def demo(**asked: object) -> Hashes:
    """Two cycles of `earthmoving demo`."""
    run = SingleProcessDig(load_run_config("demo.yaml", {"cycles": 2, **asked}))
    hashes: Hashes = []
    step = run.world.step

    def stepped():  # type: ignore[no-untyped-def]
        ledger = step()
        if run.world.tick % STRIDE == 0:
            hashes.append(world_hash(run.world))
        return ledger

    run.world.step = stepped  # type: ignore[method-assign]
    outcome = run.run()
    run.close()
    return [*hashes, outcome.state_hash]


def face(soil_name: str) -> Hashes:
    """A road header cuts a face."""
    grid = Grid(121, 121, 0.2)
    heights = np.zeros(grid.shape)
    heights[grid.x(np.arange(grid.rows)) > -1.0] = 2.2
    soil = Soil(grid, heights, SoilParams(soil=soil_name))
    machine = machine_file("road_header")
    sim = machines_on(soil, [Placement(machine, (-6.0, 0.0))], MachineSimParams(), 2_000_000)
    return operated(
        soil, sim, [FaceCuttingTask(machine, FaceCuttingParams(rounds=100, timeout=1e6))], 20.0
    )


def excavators(tracks: str, count: int, seconds: float) -> Hashes:
    """Excavators dig side by side, of which the first is loading a dumper."""
    grid = Grid(161, 161, 0.2)
    soil = Soil(grid, np.zeros(grid.shape), SoilParams(repose_angle=35.0, swell=0.15))
    digger = machine_file("excavator")
    places = [Placement(digger, (-2.0, -12.0 * k)) for k in range(count)]
    params = MachineSimParams(track_model=tracks)  # type: ignore[arg-type]
    truck = Placement(machine_file("dumper"), (0.35, 6.3))
    sim = machines_on(soil, [*places, truck], params, 2_000_000)
    behaviour = BehaviourParams(clearance=2.8, empty_threshold=0.05)
    operators: list[DigTask | FaceCuttingTask] = [
        DigTask(digger, behaviour, DigTaskParams(cycles=2, timeout=120.0)) for _ in places
    ]
    return operated(soil, sim, operators, seconds)


def two_nodes() -> Hashes:
    """Two excavators in simulations of their own, as in two machine nodes."""
    grid = Grid(161, 161, 0.2)
    soil = Soil(grid, np.zeros(grid.shape), SoilParams(soil="dry sand"))
    machine = machine_file("excavator")
    sims = {
        1 + k: machines_on(soil, [Placement(machine, (0.0, y))], MachineSimParams(), 2_000_000)
        for k, y in enumerate((-7.0, 7.0))
    }
    world = HashedWorld(soil, sims)
    down = -arm_geometry(machine).swing[2]
    for tick in range(500):
        part = tick / 500
        wanted = solve_arm_angles(machine, 7.0 - 2.0 * part, down - 0.5 * np.sin(np.pi * part), 2.0)
        for number, sim in world.machines.items():
            gap = wanted - sim.machine.joint_positions[1:]
            sim.command(np.array([0.1 * number, *(5.0 * gap)]), np.array([0.1, 0.1 * number]))
        world.step()
    world.close()
    return world.hashes


def reference_2014() -> Hashes:
    """The set-up of the 2014 work: key-point rule, cubes in pybullet."""
    content = yaml.safe_load(find_config("reference_2014.yaml").read_text(encoding="utf-8"))
    nodes = {name.split("/")[-1]: each["ros__parameters"] for name, each in content.items()}
    grid = Grid(65, 65, 0.4)
    soil = Soil(grid, np.zeros(grid.shape), SoilParams.from_mapping(nodes["soil_sim"]["soil"]))
    own = nodes["machine_sim"]
    machine = load_machine_spec(find_config(own["machine"]))
    down = -arm_geometry(machine).swing[2]
    machine = replace(
        machine, home=np.array([0.0, *solve_arm_angles(machine, 7.0, down + 0.1, 2.0)])
    )
    sim = MachineSim(
        [Placement(machine)],
        grid,
        soil.columns.height,
        params=MachineSimParams(**own["stepping"], steps_per_tick=1),
        particle_params=ParticleParams(**own["particles"]),
    )
    world = HashedWorld(soil, {1: sim})
    for tick in range(500):
        part = tick / 500
        wanted = solve_arm_angles(machine, 7.0 - 2.0 * part, down - 0.5 * np.sin(np.pi * part), 2.0)
        gap = wanted - sim.machine.joint_positions[1:]
        sim.command(np.array([0.0, *(5.0 * gap)]), np.zeros(2))
        world.step()
    world.close()
    return world.hashes


def random_driving(soil_name: str, tracks: str) -> Hashes:
    """A machine drives and digs at random on rolling ground."""
    operator = RandomOperator(tracks, 1, soil_name)  # type: ignore[arg-type]
    hashes: Hashes = []
    step = operator.world.step

    def stepped():  # type: ignore[no-untyped-def]
        ledger = step()
        if operator.world.tick % STRIDE == 0:
            hashes.append(world_hash(operator.world))
        return ledger

    operator.world.step = stepped  # type: ignore[method-assign]
    operator.run(8.0)
    operator.close()
    return hashes


def relaxation(**params: float | str) -> Hashes:
    """Walls of three soils collapse and heaps are poured, without a machine."""
    grid = Grid(97, 97, 0.2)
    heights = np.zeros(grid.shape)
    heights[:48] = 4.0
    kinds = np.zeros(grid.shape, np.uint8)
    kinds[:, 32:64], kinds[:, 64:] = 1, 2
    chosen = {"soil": "loam", "additional_soils": ("dry sand", "wet clay"), **params}
    soil = Soil(grid, heights, SoilParams(**chosen), soil=kinds)  # type: ignore[arg-type]
    cells = np.arange(grid.rows * grid.cols, dtype=np.int64)
    soil.relaxation.mark_disturbed(cells)
    rng, hashes = np.random.default_rng(3), []
    for tick in range(1, 201):
        landed = empty_rows(DEPOSIT_REQUEST, 20)
        landed["x"], landed["y"] = rng.normal(-5.0, 0.6, (2, 20))
        landed["volume_mm3"] = rng.integers(1, 40_000_000, 20)
        landed["particle_id"] = np.arange(20) + 20 * tick
        landed["soil"], landed["moisture"] = rng.integers(0, 3, 20), rng.integers(0, 101, 20)
        soil.step(tick, empty_rows(SWEEP), landed)
        if tick % 20 == 0:
            hashes.append(soil.state_hash())
    return hashes


SOILS = tuple(yaml.safe_load(find_config("soils.yaml").read_text(encoding="utf-8")))


def scenes() -> dict[str, Scene]:
    """Return all scenes by name."""
    made: dict[str, Scene] = {
        "demo": demo,
        "demo, seed 3": lambda: demo(seed=3, cycles=1),
        "truck": lambda: excavators("kinematic", 1, 40.0),
        "two excavators": lambda: excavators("kinematic", 2, 12.0),
        "physics tracks": lambda: excavators("dynamic", 1, 8.0),
        "two nodes": two_nodes,
        "face, loam": lambda: face("loam"),
        "face, rock": lambda: face("rock"),
        "reference 2014": reference_2014,
        "relaxation": relaxation,
        "relaxation, noise": lambda: relaxation(
            repose_angle_noise=4.0, redistribution_noise=0.5, surface_tilt_noise=8.0, noise_seed=5
        ),
    }
    for name in SOILS:
        made[f"random, {name}"] = lambda name=name: random_driving(name, "kinematic")  # type: ignore[misc]
    made["random, loam, physics tracks"] = lambda: random_driving("loam", "dynamic")
    return made


def main() -> int:
    """Record, compare or list; 1 if hashes differ."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("action", choices=("record", "compare", "list"))
    parser.add_argument("file", type=Path, nargs="?", help="JSON file of hashes by scene")
    parser.add_argument("--scene", action="append", help="only this one; may be given repeatedly")
    asked = parser.parse_args()
    made = scenes()
    if asked.action == "list":
        print("\n".join(made))
        return 0
    if asked.file is None:
        parser.error("name the file of hashes")
    known: dict[str, Hashes] = {}
    if asked.file.exists():
        known = json.loads(asked.file.read_text(encoding="utf-8"))
    failed = 0
    for name in asked.scene or made:
        began = time.perf_counter()
        hashes = made[name]()
        seconds = time.perf_counter() - began
        if asked.action == "record":
            known[name] = hashes
            asked.file.write_text(json.dumps(known, indent=1), encoding="utf-8")
            verdict = "recorded"
        else:
            verdict = compared(known.get(name), hashes)
            failed += verdict != "same"
        print(f"{name:<32} {len(hashes):4d} hashes  {seconds:6.1f} s  {verdict}", flush=True)
    return 1 if failed else 0


def compared(before: Hashes | None, after: Hashes) -> str:
    """Say where two runs first differ."""
    if before is None:
        return "not recorded before"
    pairs = enumerate(zip(before, after, strict=False))
    first = next((k for k, (one, other) in pairs if one != other), None)
    if first is not None:
        return f"DIFFERS from hash {first + 1} of {len(before)} on"
    return "same" if len(before) == len(after) else f"DIFFERS in length: {len(before)} before"


if __name__ == "__main__":
    sys.exit(main())
