"""Figures of an excavator at work: 18, 19, 20, 21, 26, 29 and 30."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dig_operator import BehaviourParams, DigTask, DigTaskParams, OperatorPhase
from earthmoving_sim.figures.figure import Figure
from earthmoving_sim.figures.operated_world import OperatedWorld, Script, load_spec
from earthmoving_sim.figures.studio import Photographer, Studio
from machine_sim.dem import ParticleParams
from msg_bridge.contract.grid import Grid
from soil_sim.terrain.synthetic import rough
from viewer.rendering.camera import Camera, MachineCamera, PoseCamera

__all__ = ["cab_and_smoke", "dig_a_hole", "full_bucket", "movement", "pile_from_a_hole"]

_GRID = Grid(257, 257, 0.1)
_START = (-5.0, 0.0)
_AT_HOLE = PoseCamera.around((-1.6, 0.0, 1.6), -62.0, 14.0, 12.5)
_AT_DUMP = PoseCamera.around((-3.6, 2.2, 1.6), -12.0, 14.0, 13.5)


def excavator_world(*, nominal_volume: int = 1_000_000, roughness: float = 0.02) -> OperatedWorld:
    """Return an excavator on nearly level ground.

    Args:
        nominal_volume: bank volume of a particle [mm^3].
        roughness: of the ground, root mean square [m].
    """
    site = rough(_GRID, roughness, 1.5, np.random.default_rng(0))
    return OperatedWorld(
        _GRID,
        site.heights,
        [(load_spec("excavator"), _START, 0.0)],
        particles=ParticleParams(nominal_volume=nominal_volume),
    )


def dig_task(world: OperatedWorld, cycles: int, **behaviour: float) -> DigTask:
    """Let the first machine dig a number of cycles, and return its operator."""
    spec = world.machine().machine.spec
    task = DigTaskParams(cycles=cycles, approach_distance=0.5)
    operator = DigTask(spec, BehaviourParams(**behaviour), task)  # type: ignore[arg-type]
    world.operate(operator)
    return operator


def dig_a_hole(studio: Studio) -> list[Figure]:
    """Figure 18: digging, picking up, holding, pouring, and pouring back into the hole."""
    figure = Figure(
        18,
        "Excavator digging a hole in the ground",
        "The scripted operator digs one bucketful and dumps it; it then digs a second one, which is"
        " poured back into the hole. Soil cut from the terrain becomes particles, and is terrain"
        " again where it comes to rest.",
    )
    world = excavator_world()
    with studio.photograph(world) as photographer:
        take = _series(figure, photographer, 18)
        operator = dig_task(world, 2)
        payload = _fill_of(world)
        world.run_until(lambda: operator.phase is OperatorPhase.DIG and payload() > 0.45)
        take("a", "(a) Digging", _AT_HOLE)
        world.run_until(lambda: operator.phase is OperatorPhase.LIFT)
        world.run_for(0.4)
        take("b", "(b) Picking up dirt", _AT_HOLE)
        figure.measurements["fill of the bucket"] = f"{100 * payload():.0f} % of heaped capacity"
        figure.measurements["particles"] = f"{world.sim.particles.count}"
        world.run_until(lambda: operator.phase is OperatorPhase.SWING)
        world.run_for(1.5)
        take("c", "(c) Holding", _AT_DUMP)
        fill = payload()
        world.run_until(lambda: operator.phase is OperatorPhase.DUMP and payload() < 0.6 * fill)
        take("d", "(d) Pouring and hitting the ground", _AT_DUMP)
        world.run_until(lambda: operator.cycle == 2 and operator.phase is OperatorPhase.LIFT)
        world.run_for(0.8)
        start, fill = world.time, payload()
        spec = world.machine().machine.spec
        world.operate(Script(spec, lambda now: _pour(now - start)))
        world.run_until(lambda: payload() < 0.5 * fill, limit=10.0)
        take("e", "(e) Soil poured back into the hole", _AT_HOLE)
        world.run_until(lambda: payload() < 0.02 or world.time > start + 8.0)
        world.operate(None)
        world.run_for(2.0)
        _add_ledger(figure, world)
    return [figure]


def pile_from_a_hole(studio: Studio) -> list[Figure]:
    """Figures 19 and 20: a pile, while it is formed and when it is complete."""
    pile = Figure(
        19,
        "A well-formed pile of soil",
        "Six bucketfuls of one hole, dumped in one place. The soil falls as particles; where they"
        " come to rest they become terrain, which fails where it is steeper than 35 deg.",
    )
    forming = Figure(
        20,
        "Excavator forming a soil pile from dirt",
        "The same run: soil falls onto the pile as particles, and joins it.",
    )
    world = excavator_world()
    before = world.world.surface.copy()
    view = PoseCamera.around((-4.0, 3.6, 1.6), 15.0, 16.0, 12.0)
    with studio.photograph(world) as photographer:
        take = _series(forming, photographer, 20)
        operator = dig_task(world, 6)
        payload = _fill_of(world)
        for number, cycle in enumerate((2, 4, 6)):
            world.run_until(_is_dumping(operator, cycle, payload), limit=400.0)
            world.run_for(0.5)
            take("abc"[number], f"bucketful {cycle} of 6", view)
        world.run_until(lambda: operator.done, limit=400.0)
        height = world.world.surface - before
        row, col = np.unravel_index(int(np.argmax(height)), height.shape)
        x, y = float(_GRID.x(row)), float(_GRID.y(col))
        z = float(world.world.surface[row, col])
        camera = PoseCamera((x + 6.5, y + 3.5, z + 2.4), (x - 0.8, y - 1.0, z - 0.9), fov=42.0)
        pile.pictures.append(
            photographer.take(camera, "figure_19", "Pile of six bucketfuls, and the hole behind it")
        )
        pile.measurements["height of the pile"] = f"{height.max():.2f} m"
        pile.measurements["depth of the hole"] = f"{-height.min():.2f} m"
        volume = float(height[height > 0.0].sum() * _GRID.cell**2)
        pile.measurements["bulk volume above the ground"] = f"{volume:.2f} m³"
        pile.measurements["median slope of the flank"] = f"{_flank_angle(height):.1f} deg"
        _add_ledger(pile, world)
    return [pile, forming]


def movement(studio: Studio) -> list[Figure]:
    """Figure 21: driving, turning on the spot, and swinging the upper body."""
    figure = Figure(
        21,
        "Movement of excavator model",
        "Speeds of tracks and joints are commanded; the tracks follow the uneven ground.",
    )
    site = rough(_GRID, 0.12, 3.0, np.random.default_rng(4))
    world = OperatedWorld(_GRID, site.heights, [(load_spec("excavator"), (-6.0, 0.0), 0.0)])
    spec = world.machine().machine.spec
    with studio.photograph(world) as photographer:
        take = _series(figure, photographer, 21)
        world.run_for(0.3)
        take("a", "At the start", MachineCamera("orbit", azimuth=-55, elevation=18, distance=15))
        world.operate(Script(spec, _drive))
        world.run_for(5.0)
        take("b", "Driving", MachineCamera("orbit", azimuth=-120, elevation=16, distance=15))
        world.run_for(4.0)
        take(
            "c",
            "Turned on the spot",
            MachineCamera("orbit", azimuth=-80, elevation=22, distance=15),
        )
        world.run_for(4.0)
        take(
            "d",
            "Swinging with the arm stretched",
            MachineCamera("orbit", azimuth=-100, elevation=20, distance=17),
        )
        position = world.machine().machine.base_pose[0]
        figure.measurements["distance driven"] = (
            f"{math.hypot(position[0] + 6.0, position[1]):.2f} m"
        )
    return [figure]


def full_bucket(studio: Studio) -> list[Figure]:
    """Figure 26: a full bucket, with the speed of the simulation."""
    figure = Figure(
        26,
        "Frame rate is around 25 fps, when holding a full bucket of dirt",
        "The bucket holds its heaped capacity as particles. Here the simulation does not depend on"
        " drawing; its speed is given as the real-time factor.",
    )
    world = excavator_world()
    with studio.photograph(world) as photographer:
        operator = dig_task(world, 1)
        world.run_until(lambda: operator.phase is OperatorPhase.LIFT)
        world.operate(None)
        world.run_for(0.5)
        world.restart_clock()
        world.run_for(3.0)
        count, factor = world.sim.particles.count, world.real_time_factor
        lines = [f"{count} particles", f"real-time factor {factor:.1f}"]
        camera = MachineCamera("bucket")
        figure.pictures.append(photographer.take(camera, "figure_26", "A full bucket, held", lines))
        figure.measurements["particles"] = f"{count} (reference: 50)"
        figure.measurements["real-time factor while holding"] = f"{factor:.1f} on one core"
        payload = world.machine().payload
        figure.measurements["payload"] = f"{payload.mass_kg:.0f} kg, {100 * payload.fill:.0f} %"
    return [figure]


def cab_and_smoke(studio: Studio) -> list[Figure]:
    """Figures 29 and 30: the view from the cab, and smoke from the exhaust."""
    cab = Figure(
        29,
        "View from inside the excavator",
        "The camera is where the operator's head is, in the modelled cab.",
    )
    smoke = Figure(
        30,
        "Smoke from the excavator",
        "Smoke rises from the exhaust; its amount and darkness follow the load of the engine.",
    )
    world = excavator_world()
    with studio.photograph(world) as photographer:
        operator = dig_task(world, 1)
        payload = _fill_of(world)
        world.run_until(lambda: operator.phase is OperatorPhase.DIG and payload() > 0.35)
        cab.pictures.append(
            photographer.take(MachineCamera("cab"), "figure_29", "Digging, seen from the cab")
        )
        world.run_until(lambda: operator.phase is OperatorPhase.LIFT)
        loads: list[float] = []
        world.on_show(lambda: loads.append(_engine_load(world)))
        world.run_for(1.6)
        x, y, z = world.machine().machine.base_pose[0]
        camera = PoseCamera.around((x - 1.0, y, z + 2.9), -112.0, 4.0, 7.0)
        smoke.pictures.append(
            photographer.take(camera, "figure_30", "Smoke while the arm lifts the full bucket")
        )
        smoke.measurements["load of the engine"] = (
            f"up to {100 * max(loads):.0f} % of its rated power in the 1.6 s before"
        )
    return [cab, smoke]


def _engine_load(world: OperatedWorld) -> float:
    """Return the load of the first machine's engine, 0 to 1."""
    return next(iter(world.scene.machines.values())).load


def _series(
    figure: Figure, photographer: Photographer, number: int
) -> Callable[[str, str, Camera], None]:
    """Return a function that takes a picture, a letter of a figure, and adds it."""

    def take(letter: str, caption: str, camera: Camera) -> None:
        name = f"figure_{number}{letter}"
        figure.pictures.append(photographer.take(camera, name, caption))

    return take


def _fill_of(world: OperatedWorld) -> Callable[[], float]:
    """Return a function that returns the fill of the first machine's bucket."""
    return lambda: world.machine().payload.fill


def _is_dumping(operator: DigTask, cycle: int, fill: Callable[[], float]) -> Callable[[], bool]:
    return lambda: operator.cycle == cycle and operator.phase is OperatorPhase.DUMP and fill() < 0.7


def _pour(elapsed: float) -> dict[str, float]:
    """Return the velocities that open the bucket over the hole [rad/s]."""
    return {"boom": -0.1, "bucket": -0.7} if elapsed < 3.0 else {}


def _drive(now: float) -> dict[str, float]:
    """Return the velocities of the figure of movement: drive, pivot, swing."""
    if now < 5.0:
        return {"left": 0.9, "right": 0.9}
    if now < 9.0:
        return {"left": -0.6, "right": 0.6}
    return {"swing": 0.5, "arm": -0.25, "boom": 0.06, "bucket": -0.25}


def _flank_angle(height: NDArray[np.float64]) -> float:
    """Return the median slope of the flank of a pile, between 0.2 and 0.8 of its height [deg]."""
    slope = np.hypot(*np.gradient(height, _GRID.cell))
    top = float(height.max())
    return math.degrees(
        math.atan(float(np.median(slope[(height > 0.2 * top) & (height < 0.8 * top)])))
    )


def _add_ledger(figure: Figure, world: OperatedWorld) -> None:
    figure.measurements["imbalance of the ledger"] = f"{world.world.ledger.imbalance} mm³"
