"""Figures 22, 27 and 28: a road header, and one to four road headers and excavators."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dig_operator import BehaviourParams, DigTask, DigTaskParams, FaceCuttingParams, FaceCuttingTask
from earthmoving_sim.figures.charts import draw_bars
from earthmoving_sim.figures.figure import Figure, FigurePicture
from earthmoving_sim.figures.operated_world import SOIL, OperatedWorld, load_spec
from earthmoving_sim.figures.studio import Studio
from earthmoving_sim.operated_machine import MachineOperator
from machine_sim.dem import ParticleParams
from machine_sim.machine import MachineSpec
from msg_bridge.contract.grid import Grid
from soil_sim.soils.params import SoilParams
from viewer.rendering.camera import MachineCamera, PoseCamera

__all__ = ["excavator_counts", "road_header", "road_header_counts"]

_SPACING = 9.0
"""Distance between neighbouring machines [m]."""
_GRID = Grid(257, 257, 0.2)
_MAX_MACHINES = 4
_REFERENCE_FPS = {"road_header": (90, 88, 87, 85), "excavator": (60, 40, 30, 20)}
"""Tables 4 and 5 of the reference: frames per second with 1 to 4 machines."""


def road_header(studio: Studio) -> list[Figure]:
    """Figure 22: a road header cuts a face of rock."""
    figure = Figure(
        22,
        "Road header",
        "The boom moves the rotating drum across a face of rock 2.2 m high; the rock that the picks"
        " break falls as particles.",
    )
    grid = Grid(241, 241, 0.1)
    x = grid.x(np.arange(grid.rows))
    heights, kinds = np.zeros(grid.shape), np.zeros(grid.shape, np.uint8)
    heights[x > 2.4], kinds[x > 2.2] = 2.2, 1
    spec = load_spec("road_header")
    world = OperatedWorld(
        grid,
        heights,
        [(spec, (-2.6, 0.0), 0.0)],
        soil=SoilParams(soil="loam", additional_soils=("rock",)),
        kinds=kinds,
    )
    with studio.photograph(world) as photographer:
        task = FaceCuttingParams(width=3.2, height=1.8, rounds=1, timeout=200.0)
        operator = FaceCuttingTask(spec, task)
        world.operate(operator)
        world.run_until(lambda: operator.phase == "slew" and world.time > 12.0, limit=150.0)
        for letter, camera in (
            ("a", MachineCamera("orbit", azimuth=-125.0, elevation=18.0, distance=11.0)),
            ("b", PoseCamera((0.2, -3.6, 1.7), (2.3, 0.0, 1.0), fov=45.0)),
        ):
            caption = "(a) At work" if letter == "a" else "(b) The drum in the rock"
            figure.pictures.append(photographer.take(camera, f"figure_22{letter}", caption))
        figure.measurements["particles"] = f"{world.sim.particles.count}"
        ledger = world.world.ledger
        figure.measurements["excavated bank volume"] = f"{ledger.particles / 1e9:.2f} m³ in motion"
        figure.measurements["imbalance of the ledger"] = f"{ledger.imbalance} mm³"
    return [figure]


def road_header_counts(studio: Studio) -> list[Figure]:
    """Figure 27: one to four road headers."""
    figure = Figure(
        27,
        "Varying the number of road headers",
        "Each road header cuts a face of soil with its own operator; all are in one simulation on"
        " one core.",
    )
    _measure_counts(studio, figure, "road_header", 12.0)
    return [figure]


def excavator_counts(studio: Studio) -> list[Figure]:
    """Figure 28: one to four excavators."""
    figure = Figure(
        28,
        "Varying the number of excavators",
        "Each excavator digs and dumps with its own operator; all are in one simulation on one"
        " core.",
    )
    _measure_counts(studio, figure, "excavator", 17.0)
    return [figure]


def _measure_counts(studio: Studio, figure: Figure, name: str, duration: float) -> None:
    """Run 1 to 4 machines for a simulated time [s]; add a picture of each, and a chart."""
    factors = []
    for count in range(1, _MAX_MACHINES + 1):
        world = _row_of_machines(name, count)
        with studio.photograph(world) as photographer:
            world.run_for(duration)
            factor = world.real_time_factor
            factors.append(factor)
            words = name.replace("_", " ") + ("s" if count > 1 else "")
            lines = [f"{count} {words}", f"real-time factor {factor:.1f}"]
            figure.pictures.append(
                photographer.take(
                    _row_camera(count), f"figure_{figure.number}_{count}", f"{count} {words}", lines
                )
            )
            figure.measurements[f"{count} {words}"] = (
                f"real-time factor {factor:.2f}, up to {world.max_particles} particles, imbalance"
                f" {world.world.ledger.imbalance} mm³"
            )
    figure.pictures.append(_chart(studio.folder, figure.number, name, factors))


def _row_of_machines(name: str, count: int) -> OperatedWorld:
    """Return some machines side by side, each with its operator."""
    spec = load_spec(name)
    heights = np.zeros(_GRID.shape)
    if name == "road_header":
        heights[_GRID.x(np.arange(_GRID.rows)) > -1.0] = 2.2
    world = OperatedWorld(
        _GRID,
        heights,
        [(spec, (-6.0, (k - 0.5 * (count - 1)) * _SPACING), 0.0) for k in range(count)],
        soil=SOIL,
        particles=ParticleParams(nominal_volume=2_000_000),
    )
    for index in range(count):
        world.operate(_operator(name, spec), index)
    return world


def _operator(name: str, spec: MachineSpec) -> MachineOperator:
    if name == "road_header":
        return FaceCuttingTask(spec, FaceCuttingParams(rounds=100, timeout=1e6))
    task = DigTaskParams(cycles=100, approach_distance=0.5, timeout=1e6, dump_angle=80.0)
    return DigTask(spec, BehaviourParams(dump_radius=5.0), task)


def _row_camera(count: int) -> PoseCamera:
    """Return a camera that shows a row of machines from behind."""
    width = (count - 1) * _SPACING
    return PoseCamera(
        (-14.0 - 0.42 * width, -7.0 - 0.3 * width, 5.0 + 0.14 * width),
        (-4.0, -0.13 * width, 0.8),
        fov=42.0,
    )


def _chart(folder: Path, number: int, name: str, factors: list[float]) -> FigurePicture:
    """Draw real-time factors here, and frame rates of the reference, over the number."""
    path = folder / f"figure_{number}_chart.png"
    draw_bars(
        path,
        title=f"Speed with 1 to {_MAX_MACHINES} {name.replace('_', ' ')}s",
        subtitle="Here: simulated over computing time, one core, with soil. Reference: frames per"
        " second, without.",
        labels=[str(k + 1) for k in range(_MAX_MACHINES)],
        here=factors,
        reference=[float(fps) for fps in _REFERENCE_FPS[name]],
        axis="number of machines",
    )
    return FigurePicture(path, "Speed over the number of machines, beside that of the reference")
