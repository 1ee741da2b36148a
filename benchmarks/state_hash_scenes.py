"""Scenes whose state hashes `state_hashes` records: soil and machines in one process."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import yaml
from numpy.typing import NDArray

from benchmarks.bucket_sweeps import NO_SWEEPS
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
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.rows import DEPOSIT_REQUEST, empty_rows
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

__all__ = ["Hashes", "Scene", "make_scenes"]

Hashes = list[str]
Scene = Callable[[], Hashes]

STRIDE = 100
"""Ticks between hashes."""
NOMINAL_VOLUME = 2_000_000
"""Nominal bank volume of a particle where a scene has no other [mm^3]."""
SCRIPT_TICKS = 500
"""Ticks of a scripted arm motion."""


def make_scenes() -> dict[str, Scene]:
    """Return all scenes by name."""
    scenes: dict[str, Scene] = {
        "demo": run_demo,
        "demo, seed 3": lambda: run_demo(seed=3, cycles=1),
        "truck": lambda: load_dumper("kinematic", 1, 40.0),
        "two excavators": lambda: load_dumper("kinematic", 2, 12.0),
        "physics tracks": lambda: load_dumper("dynamic", 1, 8.0),
        "two nodes": run_two_simulations,
        "face, loam": lambda: cut_face("loam"),
        "face, rock": lambda: cut_face("rock"),
        "reference 2014": run_reference_2014,
        "relaxation": relax_and_deposit,
        "relaxation, noise": lambda: relax_and_deposit(
            repose_angle_noise=4.0, redistribution_noise=0.5, surface_tilt_noise=8.0, noise_seed=5
        ),
    }
    soils = yaml.safe_load(find_config("soils.yaml").read_text(encoding="utf-8"))
    for name in soils:
        scenes[f"random, {name}"] = lambda name=name: dig_at_random(name, "kinematic")  # type: ignore[misc]
    scenes["random, loam, physics tracks"] = lambda: dig_at_random("loam", "dynamic")
    return scenes


def load_spec(name: str) -> MachineSpec:
    """Return a shipped machine."""
    return load_machine_spec(find_config(f"machines/{name}.yaml"))


def make_simulation(
    soil: Soil, placements: list[Placement], params: MachineSimParams | None = None
) -> MachineSim:
    """Return a simulation of machines on a terrain."""
    return MachineSim(
        placements,
        soil.grid,
        soil.columns.height,
        params=params or MachineSimParams(),
        soils=soil.loose_soils,
        soil=soil.columns.top_soil,
        moisture=soil.columns.top_moisture,
        particle_params=ParticleParams(nominal_volume=NOMINAL_VOLUME),
    )


class HashedWorld(World):
    """A world that stores its hash every `STRIDE` ticks and checks the volume balance.

    Attributes:
        hashes: hashes of soil and machines, one for each stride.
    """

    def __init__(self, soil: Soil, machines: Mapping[int, MachineSim]) -> None:
        self.hashes: Hashes = []
        super().__init__(soil, machines)

    def step(self) -> Ledger:
        ledger = super().step()
        if ledger.imbalance:
            raise AssertionError(f"imbalance {ledger.imbalance} mm3 at tick {ledger.tick}")
        if self.tick % STRIDE == 0:
            self.hashes.append(world_hash(self))
        return ledger


def world_hash(world: World) -> str:
    """Return the SHA-256 [hex] of the state hashes of the soil and of all machines."""
    parts = [world.state_hash(), *(machine.state_hash() for machine in world.machines.values())]
    return hashlib.sha256(" ".join(parts).encode()).hexdigest()


def store_hashes(world: World) -> Hashes:
    """Return a list to which each following step of `world` adds its hash every `STRIDE` ticks."""
    hashes: Hashes = []
    step = world.step

    def step_and_hash() -> Ledger:
        ledger = step()
        if world.tick % STRIDE == 0:
            hashes.append(world_hash(world))
        return ledger

    world.step = step_and_hash  # type: ignore[method-assign]
    return hashes


def run_operators(
    soil: Soil, sim: MachineSim, operators: list[DigTask | FaceCuttingTask], seconds: float
) -> Hashes:
    """Run the first machines with an operator each; machines without an operator stand still."""
    world, tick_period = HashedWorld(soil, {1: sim}), sim.params.tick_period
    machines = [
        OperatedMachine(world, machine, operator, tick_period)
        for machine, operator in zip(sim.simulated_machines, operators, strict=False)
    ]
    while world.tick * tick_period < seconds:
        for machine in machines:
            machine.observe_and_command(2 * tick_period)
        for _ in range(2):
            world.step()
    world.close()
    return world.hashes


def run_demo(**settings: object) -> Hashes:
    """Run two cycles of `earthmoving demo`, or with other settings."""
    dig = SingleProcessDig(load_run_config("demo.yaml", {"cycles": 2, **settings}))
    hashes = store_hashes(dig.world)
    outcome = dig.run()
    dig.close()
    return [*hashes, outcome.state_hash]


def cut_face(soil_name: str) -> Hashes:
    """Run a road header that cuts a face of a soil."""
    grid = Grid(121, 121, 0.2)
    heights = np.zeros(grid.shape)
    heights[grid.x(np.arange(grid.rows)) > -1.0] = 2.2
    soil = Soil(grid, heights, SoilParams(soil=soil_name))
    spec = load_spec("road_header")
    sim = make_simulation(soil, [Placement(spec, (-6.0, 0.0))])
    operator = FaceCuttingTask(spec, FaceCuttingParams(rounds=100, timeout=1e6))
    return run_operators(soil, sim, [operator], 20.0)


def load_dumper(tracks: str, num_excavators: int, seconds: float) -> Hashes:
    """Run excavators that dig side by side; the first one loads a dumper."""
    grid = Grid(161, 161, 0.2)
    soil = Soil(grid, np.zeros(grid.shape), SoilParams(repose_angle=35.0, swell=0.15))
    spec = load_spec("excavator")
    placements = [Placement(spec, (-2.0, -12.0 * k)) for k in range(num_excavators)]
    dumper = Placement(load_spec("dumper"), (0.35, 6.3))
    params = MachineSimParams(track_model=tracks)  # type: ignore[arg-type]
    sim = make_simulation(soil, [*placements, dumper], params)
    behaviour = BehaviourParams(clearance=2.8, empty_threshold=0.05)
    operators: list[DigTask | FaceCuttingTask] = [
        DigTask(spec, behaviour, DigTaskParams(cycles=2, timeout=120.0)) for _ in placements
    ]
    return run_operators(soil, sim, operators, seconds)


def scripted_scoop(
    spec: MachineSpec, tick: int, joint_positions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return velocities [rad/s] of boom, arm and bucket that follow a scoop toward the machine."""
    progress = tick / SCRIPT_TICKS
    ground = -arm_geometry(spec).swing[2]
    height = ground - 0.5 * np.sin(np.pi * progress)
    target = solve_arm_angles(spec, 7.0 - 2.0 * progress, height, 2.0)
    return np.asarray(5.0 * (target - joint_positions[1:]))


def run_two_simulations() -> Hashes:
    """Run two excavators in separate simulations, as in two machine nodes."""
    grid = Grid(161, 161, 0.2)
    soil = Soil(grid, np.zeros(grid.shape), SoilParams(soil="dry sand"))
    spec = load_spec("excavator")
    sims = {k: make_simulation(soil, [Placement(spec, (0.0, y))]) for k, y in ((1, -7.0), (2, 7.0))}
    world = HashedWorld(soil, sims)
    for tick in range(SCRIPT_TICKS):
        for number, sim in world.machines.items():
            arm = scripted_scoop(spec, tick, sim.machine.joint_positions)
            sim.command(np.array([0.1 * number, *arm]), np.array([0.1, 0.1 * number]))
        world.step()
    world.close()
    return world.hashes


def run_reference_2014() -> Hashes:
    """Run the set-up of the 2014 reference: key-point rule, cubes in pybullet."""
    content = yaml.safe_load(find_config("reference_2014.yaml").read_text(encoding="utf-8"))
    nodes = {name.split("/")[-1]: each["ros__parameters"] for name, each in content.items()}
    grid = Grid(65, 65, 0.4)
    soil = Soil(grid, np.zeros(grid.shape), SoilParams.from_mapping(nodes["soil_sim"]["soil"]))
    params = nodes["machine_sim"]
    spec = load_machine_spec(find_config(params["machine"]))
    ground = -arm_geometry(spec).swing[2]
    home = np.array([0.0, *solve_arm_angles(spec, 7.0, ground + 0.1, 2.0)])
    spec = replace(spec, home=home)
    sim = MachineSim(
        [Placement(spec)],
        grid,
        soil.columns.height,
        params=MachineSimParams(**params["stepping"], steps_per_tick=1),
        particle_params=ParticleParams(**params["particles"]),
    )
    world = HashedWorld(soil, {1: sim})
    for tick in range(SCRIPT_TICKS):
        arm = scripted_scoop(spec, tick, sim.machine.joint_positions)
        sim.command(np.array([0.0, *arm]), np.zeros(2))
        world.step()
    world.close()
    return world.hashes


def dig_at_random(soil_name: str, tracks: str) -> Hashes:
    """Run an excavator that drives and digs at random on rolling ground."""
    operator = RandomOperator(tracks, 1, soil_name)  # type: ignore[arg-type]
    hashes = store_hashes(operator.world)
    operator.run(8.0)
    operator.close()
    return hashes


def relax_and_deposit(**params: float | str) -> Hashes:
    """Let faces of three soils fail while volumes are deposited, without a machine."""
    grid = Grid(97, 97, 0.2)
    heights = np.zeros(grid.shape)
    heights[:48] = 4.0
    soil_index = np.zeros(grid.shape, np.uint8)
    soil_index[:, 32:64], soil_index[:, 64:] = 1, 2
    settings = {"soil": "loam", "additional_soils": ("dry sand", "wet clay"), **params}
    soil = Soil(grid, heights, SoilParams(**settings), soil=soil_index)  # type: ignore[arg-type]
    soil.relaxation.mark_disturbed(np.arange(grid.rows * grid.cols, dtype=np.int64))
    rng, hashes = np.random.default_rng(3), []
    for tick in range(1, 201):
        requests = empty_rows(DEPOSIT_REQUEST, 20)
        requests["x"], requests["y"] = rng.normal(-5.0, 0.6, (2, 20))
        requests["volume_mm3"] = rng.integers(1, 40_000_000, 20)
        requests["particle_id"] = np.arange(20) + 20 * tick
        requests["soil"], requests["moisture"] = rng.integers(0, 3, 20), rng.integers(0, 101, 20)
        soil.step(tick, NO_SWEEPS, requests)
        if tick % 20 == 0:
            hashes.append(soil.state_hash())
    return hashes
