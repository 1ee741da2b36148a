"""Draw machines at work: an excavator that loads a dumper or leaves a windrow, a road header.

    python -m benchmarks.machine_gallery docs/images     # one or two minutes

Writes machines_loading.png, machines_face.png and machines_windrow.png into the given folder, or
into out/.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.full_lever_digging import LeverRun, swing
from dig_operator import BehaviourParams, DigTask, DigTaskParams, FaceCuttingParams, FaceCuttingTask
from earthmoving_sim.coloured_mesh import ColouredMesh, merge_meshes, polygon_mesh
from earthmoving_sim.machine_mesh import machine_mesh
from earthmoving_sim.operated_machine import OperatedMachine
from earthmoving_sim.pictures.site_3d import draw_site_3d
from earthmoving_sim.pictures.site_record import SiteRecord
from earthmoving_sim.world import World
from machine_sim.dem import ParticleParams, SoilEngine
from machine_sim.machine import TrackedMachine, load_machine_spec, rotation_matrix
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

_PARTICLE_COLOUR = (0.49, 0.353, 0.22)
_NOMINAL_VOLUME = 1_000_000
"""Nominal bank volume of a particle [mm^3]."""
_COMMAND_INTERVAL_TICKS = 2
_TIMEOUT = 120.0
"""Simulated time after which a scene is drawn unfinished [s]."""

_OCTAHEDRON = np.array(
    [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], dtype=np.float64
)
_OCTAHEDRON_FACES = [(x, y, z) for x in (0, 1) for y in (2, 3) for z in (4, 5)]


def main() -> None:
    """Draw all pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "folder", type=Path, nargs="?", default=Path("out"), help="folder to write into"
    )
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    scenes = {"loading": load_dumper, "face": cut_face, "windrow": leave_windrow}
    for name, draw in scenes.items():
        print(draw_site_3d(draw(), folder / f"machines_{name}.png", labels=False))


def load_dumper() -> SiteRecord:
    """Return the site while an excavator dumps its second bucket into a dumper."""
    grid = Grid(161, 161, 0.2)
    soil = Soil(grid, np.zeros(grid.shape), SoilParams(repose_angle=35.0, swell=0.15))
    sim = _simulate(soil, [("excavator", (-2.0, 0.0)), ("dumper", (0.35, 6.3))])
    behaviour = BehaviourParams(clearance=2.8, empty_threshold=0.05)
    operator = DigTask(
        sim.simulated_machines[0].machine.spec, behaviour, DigTaskParams(cycles=2, timeout=_TIMEOUT)
    )

    def is_half_empty() -> bool:
        is_dumping = operator.cycle == 2 and operator.phase == "dump"
        return is_dumping and sim.simulated_machines[0].payload.fill < 0.5

    return _work(soil, sim, operator, is_half_empty, "An excavator loads a dumper")


def cut_face() -> SiteRecord:
    """Return the site while a drum crosses a face of rock for the first time."""
    grid = Grid(141, 141, 0.1)
    x = grid.x(np.arange(grid.rows))
    heights, ids = np.zeros(grid.shape), np.zeros(grid.shape, np.uint8)
    heights[x > 2.4], ids[x > 2.2] = 2.2, 1
    soil = Soil(grid, heights, SoilParams(soil="loam", additional_soils=("rock",)), soil=ids)
    sim = _simulate(soil, [("road_header", (-2.6, 0.0))])
    task = FaceCuttingParams(width=3.2, height=1.8, rounds=1, timeout=_TIMEOUT)
    operator = FaceCuttingTask(sim.machine.spec, task)

    def is_in_the_middle() -> bool:
        return operator.phase == "slew" and abs(float(sim.machine.joint_positions[0])) < 0.05

    return _work(soil, sim, operator, is_in_the_middle, "A road header cuts a face of rock")


def leave_windrow() -> SiteRecord:
    """Return the site after a full-lever swing with the bucket in the ground."""
    run = LeverRun(1, grid=Grid(181, 181, 0.1))
    before = run.world.soil.columns.height.copy()
    swing(run, 3.0)
    title = "Windrow of a swing with the bucket in the ground"
    record = record_site(run.world.soil, run.sim, before, title)
    run.world.close()
    return record


def _simulate(soil: Soil, machines: list[tuple[str, tuple[float, float]]]) -> MachineSim:
    """Return a simulation of shipped machines by name and position [m]."""
    return MachineSim(
        [
            Placement(load_machine_spec(find_config(f"machines/{name}.yaml")), position)
            for name, position in machines
        ],
        soil.grid,
        soil.columns.height,
        soils=soil.loose_soils,
        particle_params=ParticleParams(nominal_volume=_NOMINAL_VOLUME),
    )


def _work(
    soil: Soil,
    sim: MachineSim,
    operator: DigTask | FaceCuttingTask,
    is_finished: Callable[[], bool],
    title: str,
) -> SiteRecord:
    """Run the operator of the first machine until `is_finished`, and record the site."""
    world, tick = World(soil, {1: sim}), sim.params.tick_period
    operated = OperatedMachine(world, sim.simulated_machines[0], operator, tick)
    before = soil.columns.height.copy()
    while not (operator.done or is_finished()):
        operated.observe_and_command(_COMMAND_INTERVAL_TICKS * tick)
        for _ in range(_COMMAND_INTERVAL_TICKS):
            world.step()
        if world.tick % 500 == 0:
            print(f"  {title}: {world.tick * tick:.0f} s, {operator.phase}", flush=True)
    record = record_site(soil, sim, before, title)
    world.close()
    return record


def record_site(soil: Soil, sim: MachineSim, before: NDArray[np.float64], title: str) -> SiteRecord:
    """Return a site as it is now, to be drawn.

    Args:
        soil: the terrain.
        sim: machines and particles.
        before: initial heights of the terrain [m].
        title: of the picture.
    """
    machine = sim.machine
    meshes = [_mesh(each.machine) for each in sim.simulated_machines]
    particles = polygon_mesh(_particle_polygons(sim.particles), first_part=10_000)
    meshes += [particles] if particles else []
    return SiteRecord(
        grid=soil.grid,
        before=before,
        after=soil.columns.height.copy(),
        loose_depth=soil.columns.loose_depth,
        lip_path=np.zeros((0, 3)),
        lip_cycle=np.zeros(0, int),
        lip_phase=np.zeros(0, str),
        machine_outline=(),
        title=title,
        machine_mesh=merge_meshes(*meshes),
        machine_position=(float(machine.base_pose[0][0]), float(machine.base_pose[0][1])),
    )


def _mesh(machine: TrackedMachine) -> ColouredMesh:
    """Return the triangles of a machine, map frame."""
    position, quaternion = machine.base_pose
    pose = (position, rotation_matrix(quaternion), machine.joint_positions)
    return machine_mesh(machine.spec, *pose, machine.tracks.shoe_poses)


def _particle_polygons(
    particles: SoilEngine,
) -> Iterator[tuple[tuple[float, float, float], NDArray[np.float64]]]:
    """Yield the faces of an octahedron for each particle."""
    for position, radius in zip(particles.positions, particles.radii, strict=True):
        corners = position + float(radius) * _OCTAHEDRON
        for face in _OCTAHEDRON_FACES:
            yield _PARTICLE_COLOUR, corners[list(face)]


if __name__ == "__main__":
    main()
