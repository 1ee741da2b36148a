"""Draw machines at work: an excavator that loads, leaves a windrow or dumps clay, a road header.

    python -m benchmarks.machine_gallery docs/images     # two or three minutes
    python -m benchmarks.machine_gallery docs/images --scenes clay stalled

Writes machines_SCENE.png for each scene into the given folder, or into out/.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.full_lever_digging import LEVERS_AT_REST, LeverRun, swing
from benchmarks.validation.face_milling import FaceSite
from dig_operator import BehaviourParams, DigTask, DigTaskParams, FaceCuttingParams, FaceCuttingTask
from earthmoving_sim.coloured_mesh import ColouredMesh, merge_meshes, polygon_mesh
from earthmoving_sim.machine_mesh import machine_mesh
from earthmoving_sim.operated_machine import OperatedMachine
from earthmoving_sim.pictures.rasterizer import Camera
from earthmoving_sim.pictures.shading import render
from earthmoving_sim.pictures.site_3d import ABOVE, BORDER, draw_site_3d
from earthmoving_sim.pictures.site_record import SiteRecord
from earthmoving_sim.pictures.style import DPI, add_axes, add_title, new_figure, save
from earthmoving_sim.world import World
from machine_sim.dem import ParticleParams, SoilEngine
from machine_sim.machine import TrackedMachine, load_machine_spec, rotation_matrix
from machine_sim.simulated_machine import Placement, SimulatedMachine
from machine_sim.simulation import MachineSim
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

_PARTICLE_COLOUR = (0.49, 0.353, 0.22)
_NOMINAL_VOLUME = 1_000_000
"""Nominal bank volume of a particle [mm^3]."""
_COMMAND_INTERVAL_TICKS = 2
_TIMEOUT = 200.0
"""Simulated time after which a scene is drawn unfinished [s]."""

_TRUCK = "truck"
"""Name of the dumper for the operator of the excavator."""

_LAST_BUCKET_FILL = 0.7
"""Fill of the dumper's bed that its last bucket exceeds."""

_CLOSE_UP_RADIUS = 1.3
"""Distance from the middle of a close-up to which it shows machine and particles [m]."""
_CLOSE_UP_WIDTH = 7.0
"""Width of a close-up [in]."""
_CLOSE_UP_ELEVATION = 1.0
"""Elevation of the camera and of the bucket's opening in a close-up [rad]."""

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
    parser.add_argument("--scenes", choices=SCENES, nargs="+", default=list(SCENES))
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for name in options.scenes:
        path = options.folder / f"machines_{name}.png"
        print(SCENES[name](path))


def load_dumper() -> SiteRecord:
    """Return the site while an excavator dumps the last bucket into a dumper."""
    grid = Grid(161, 161, 0.2)
    soil = Soil(grid, np.zeros(grid.shape), SoilParams(soil="loam"))
    sim = _simulate(soil, [("excavator", (-2.0, 0.0), 0.0), ("dumper", (-2.0, 5.8), math.pi)])
    digger, dumper = sim.simulated_machines
    operator = DigTask(
        digger.machine.spec,
        BehaviourParams(),
        DigTaskParams(truck=_TRUCK, approach_distance=0.0, loads=1, timeout=_TIMEOUT),
    )

    def is_nearly_full() -> bool:
        is_dumping = operator.phase == "dump" and digger.payload.fill < 0.4
        return is_dumping and dumper.payload.fill > _LAST_BUCKET_FILL

    others = {_TRUCK: dumper}
    return _work(soil, sim, operator, is_nearly_full, "An excavator loads a dumper", others)


def cut_face() -> SiteRecord:
    """Return the site while a drum crosses a face of rock for the first time."""
    grid = Grid(141, 141, 0.1)
    x = grid.x(np.arange(grid.rows))
    heights, ids = np.zeros(grid.shape), np.zeros(grid.shape, np.uint8)
    heights[x > 2.4], ids[x > 2.2] = 2.2, 1
    soil = Soil(grid, heights, SoilParams(soil="loam", additional_soils=("rock",)), soil=ids)
    sim = _simulate(soil, [("road_header", (-2.6, 0.0), 0.0)])
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


def draw_sticking_clay(path: Path) -> Path:
    """Draw the open bucket of an excavator that has dumped wet clay, with what hangs in it."""
    run = LeverRun(1, "wet clay")
    run.hold_until((0, 1, 0, 0), lambda: run.depth > 0.3, 4.0)
    run.hold_until((0, 0, 1, 0), lambda: run.sim.payload.fill > 0.8, 3.0)
    run.hold((0, 0, 0, 1), 1.5)
    run.hold((0, -1, 0, 0), 1.5)
    full = run.sim.payload.fill
    run.hold((0, 0, 0, -1), 4.0)
    run.hold(LEVERS_AT_REST, 3.0)
    left = 100.0 * run.sim.payload.fill / full
    bucket, (rotation, origin) = run.sim.machine.spec.bucket, run.sim.machine.tool.pose
    lip, rim = (np.array([x, 0.0, z]) for x, z in (bucket.profile[0], bucket.profile[-1]))
    middle = origin + rotation @ (0.5 * (lip + rim))
    mesh = merge_meshes(
        _mesh(run.sim.machine),
        *filter(None, [polygon_mesh(_particle_polygons(run.sim.particles), first_part=10_000)]),
    )
    inward = rotation @ np.array([bucket.profile[:, 0].mean(), 0.0, bucket.profile[:, 1].mean()])
    toward = middle - origin - inward
    # Light comes from above: turn the bucket about the lip's direction until the camera is there.
    tilt = _CLOSE_UP_ELEVATION - math.asin(toward[2] / float(np.linalg.norm(toward)))
    azimuth = math.atan2(toward[1], toward[0])
    axis = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
    turn = rotation_matrix([*(math.sin(-0.5 * tilt) * axis), math.cos(0.5 * tilt)])
    mesh = replace(mesh, points=(mesh.points - middle) @ turn.T, normals=mesh.normals @ turn.T)
    run.world.close()
    return _draw_close_up(
        mesh,
        Camera(azimuth, _CLOSE_UP_ELEVATION),
        path,
        f"Wet clay after the dump: {left:.0f} % of it hangs in the bucket",
        "view into the bucket, which opens downward; lit from the camera",
    )


def _draw_close_up(
    mesh: ColouredMesh, camera: Camera, path: Path, title: str, subtitle: str
) -> Path:
    """Write a picture of the triangles around the origin as PNG, and return its path.

    Args:
        mesh: triangles.
        camera: direction of the view.
        path: path of the picture.
        title, subtitle: its titles.
    """
    is_near = np.linalg.norm(mesh.points, axis=1) < _CLOSE_UP_RADIUS
    keep = is_near[mesh.triangles].all(axis=1)
    part = replace(mesh, triangles=mesh.triangles[keep], parts=mesh.parts[keep])
    view = camera.view(mesh.points[np.unique(part.triangles)])[:, :2]
    low, size = view.min(axis=0), np.ptp(view, axis=0)
    scale = _CLOSE_UP_WIDTH / float(size[0])  # [in/m]
    height = scale * float(size[1])
    figure = new_figure(_CLOSE_UP_WIDTH + 2.0 * BORDER, height + 2.0 * BORDER + ABOVE)
    axes = add_axes(figure, BORDER, BORDER, _CLOSE_UP_WIDTH, height)
    shape = (round(height * DPI), round(_CLOSE_UP_WIDTH * DPI))
    axes.imshow(render(part, camera, low, scale * DPI, shape), origin="lower")
    axes.set_axis_off()
    add_title(figure, title, subtitle, BORDER)
    return save(figure, path)


def stall_in_rock() -> SiteRecord:
    """Return the site after a road header has driven its head into rock until the head stalled."""
    site = FaceSite("rock")
    before = site.soil.columns.height.copy()
    site.drive(0.0, 7.5, 1.2)
    site.drive(0.1, 7.5, 2.6)
    title = f"A cutting head that has stalled in rock: {abs(site.head_speed):.1f} of 7.5 rad/s"
    record = record_site(site.soil, site.sim, before, title)
    site.world.close()
    return record


def _draw(record: Callable[[], SiteRecord]) -> Callable[[Path], Path]:
    """Return a function that draws a site into a file."""
    return lambda path: draw_site_3d(record(), path, labels=False)


SCENES: dict[str, Callable[[Path], Path]] = {
    "loading": _draw(load_dumper),
    "face": _draw(cut_face),
    "windrow": _draw(leave_windrow),
    "clay": draw_sticking_clay,
    "stalled": _draw(stall_in_rock),
}
"""Scenes by the name of their picture."""


def _simulate(soil: Soil, machines: list[tuple[str, tuple[float, float], float]]) -> MachineSim:
    """Return a simulation of shipped machines by name, position [m] and heading [rad]."""
    return MachineSim(
        [
            Placement(load_machine_spec(find_config(f"machines/{name}.yaml")), position, yaw)
            for name, position, yaw in machines
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
    others: Mapping[str, SimulatedMachine] | None = None,
) -> SiteRecord:
    """Run the operator of the first machine until `is_finished`, and record the site."""
    world, tick = World(soil, {1: sim}), sim.params.tick_period
    operated = OperatedMachine(world, sim.simulated_machines[0], operator, tick, others=others)
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
