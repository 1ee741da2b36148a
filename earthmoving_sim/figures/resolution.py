"""Figures 23, 24 and 25: resolution of the terrain and number of particles against speed."""

from __future__ import annotations

import numpy as np

from dig_operator import BehaviourParams, DigTask, DigTaskParams, OperatorPhase
from earthmoving_sim.figures.charts import draw_particle_speed
from earthmoving_sim.figures.figure import Figure, FigurePicture
from earthmoving_sim.figures.operated_world import OperatedWorld, load_spec
from earthmoving_sim.figures.studio import Studio
from machine_sim.dem import ParticleParams
from msg_bridge.contract.grid import Grid
from soil_sim.terrain.synthetic import rough
from viewer.rendering.camera import PoseCamera

__all__ = ["particle_counts", "resolutions"]

_SIDE = 102.4
"""Side of the terrain of the reference [m]."""

_RESOLUTIONS = ((129, 75), (257, 60), (513, 15))
"""Points along each side, and frames per second of the reference (table 2)."""

_REFERENCE_PARTICLES = (
    (25, 35.0),
    (50, 25.0),
    (75, 20.0),
    (100, 15.0),
    (125, 11.0),
    (150, 9.0),
    (175, 8.0),
    (200, 7.0),
)
"""Particles and frames per second of the reference (table 3)."""

_NOMINAL_VOLUMES = (40_000_000, 20_000_000, 10_000_000, 5_000_000, 2_000_000, 1_000_000, 300_000)
"""Bank volumes of a particle [mm^3], for 25 to some thousand particles in a bucketful."""

_CAMERA = PoseCamera.around((-1.2, 1.4, 0.9), -50.0, 22.0, 12.5)


def resolutions(studio: Studio) -> list[Figure]:
    """Figures 23 and 24: the same dig on terrains of 129, 257 and 513 points."""
    several = Figure(
        23,
        "Different heightmap resolutions",
        "The same dig cycle on a terrain of 102.4 m with 129, 257 and 513 points along each side."
        " The cost of a tick depends on the columns that change, not on the size of the map.",
    )
    single = Figure(
        24,
        "With a heightmap resolution of 257, the frame rate was around 6 fps",
        "The terrain with 257 points, with the speed of the simulation in the picture. The text of"
        " the reference gives 60 fps for it, the caption 6.",
    )
    for letter, (points, fps) in zip("abc", _RESOLUTIONS, strict=True):
        world = _dig_world(Grid(points, points, _SIDE / (points - 1)), 2_000_000)
        with studio.photograph(world) as photographer:
            factor = _dig_one_cycle(world)
            lines = [f"{points} x {points} points", f"real-time factor {factor:.1f}"]
            caption = f"({letter}) {points} points, cells of {_SIDE / (points - 1):g} m"
            several.pictures.append(photographer.take(_CAMERA, f"figure_23{letter}", caption))
            several.measurements[f"{points} points"] = (
                f"real-time factor {factor:.1f} (reference: {fps} fps)"
            )
            if points == 257:
                single.pictures.append(photographer.take(_CAMERA, "figure_24", caption[4:], lines))
                single.measurements["real-time factor"] = f"{factor:.1f} on one core"
    return [several, single]


def particle_counts(studio: Studio) -> list[Figure]:
    """Figure 25: speed over the number of particles."""
    figure = Figure(
        25,
        "Particle count vs. approximate frame rate",
        "One dig cycle with particles of smaller and smaller volume, so that the same soil consists"
        " of more of them.",
    )
    counts, factors = [], []
    for volume in _NOMINAL_VOLUMES:
        world = _dig_world(Grid(257, 257, 0.2), volume)
        factors.append(_dig_one_cycle(world))
        counts.append(world.max_particles)
        figure.measurements[f"{world.max_particles} particles"] = (
            f"real-time factor {factors[-1]:.1f} (particles of {volume / 1e6:g} L)"
        )
        world.close()
    path = studio.folder / "figure_25.png"
    draw_particle_speed(path, counts=counts, factors=factors, reference=_REFERENCE_PARTICLES)
    figure.pictures.append(FigurePicture(path, "Speed over the number of particles"))
    return [figure]


def _dig_world(grid: Grid, nominal_volume: int) -> OperatedWorld:
    site = rough(grid, 0.02, 3.0, np.random.default_rng(1))
    return OperatedWorld(
        grid,
        site.heights,
        [(load_spec("excavator"), (-4.0, 0.0), 0.0)],
        particles=ParticleParams(nominal_volume=nominal_volume),
    )


def _dig_one_cycle(world: OperatedWorld) -> float:
    """Dig and dump one bucketful; return the real-time factor from the first contact on."""
    task = DigTaskParams(cycles=1, approach_distance=0.5)
    operator = DigTask(world.machine().machine.spec, BehaviourParams(), task)
    world.operate(operator)
    world.run_until(lambda: operator.phase is OperatorPhase.DIG)
    world.restart_clock()
    world.run_until(lambda: operator.done)
    return world.real_time_factor
