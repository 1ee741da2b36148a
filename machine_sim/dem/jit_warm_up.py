"""Compilation of every kernel before the first real step."""

from __future__ import annotations

from functools import cache

import numpy as np

from machine_sim.dem.engine import ParticleEngine
from machine_sim.dem.params import ParticleParams
from machine_sim.ground.contact_surface import Ground
from msg_bridge.contract.grid import Grid

__all__ = ["warm_up"]

_STEP = 0.005
_LITRE = 10**6


def warm_up(params: ParticleParams | None = None) -> None:
    """Run a tiny scene through every kernel: seconds with an empty cache, else much less.

    Args:
        params: parameters of the physics, defaults if None. Only `threads` counts: several threads
            have kernels of their own.
    """
    _run_scene(params.threads if params else 1)


@cache
def _run_scene(threads: int) -> None:
    """Run the scene, once in a process."""
    engine = _box_scene(threads)
    points = [[0.0, 0.0, 0.3], [0.0, 0.05, 0.3], [1.5, 0.0, 0.05]]
    ids = engine.add(points, np.zeros((3, 3)), _LITRE)
    for _ in range(12):
        engine.step(_STEP)
        engine.settled()
    engine.sort_rows()
    engine.freeze(ids[:1])
    engine.remove(ids[:1])
    engine.step(_STEP)
    # A particle that is too fast for the cells of the neighbour list.
    engine.add([0.0, 0.9, 0.5], [9.0, 0.0, 0.0], _LITRE, grow=False)
    engine.step(_STEP)
    _ = engine.max_overlap
    engine.remove(engine.ids)
    _exercise_sleep(engine)


def _box_scene(threads: int) -> ParticleEngine:
    """Return a tray over a small map; all that touches it falls asleep at once."""
    params = ParticleParams(threads=threads, sleep_speed=1.0, sleep_time=0.0, settle_time=0.0)
    engine = ParticleEngine(params, Ground(Grid(4, 4, 1.0), np.zeros((4, 4))))
    floor = [[-0.5, -0.5, 0.2], [0.5, -0.5, 0.2], [0.5, 0.5, 0.2], [-0.5, 0.5, 0.2]]
    side = [[-0.5, -0.5, 0.2], [0.5, -0.5, 0.2], [0.5, -0.5, 0.8], [-0.5, -0.5, 0.8]]
    engine.add_tool(0, [floor, side], (np.eye(3), np.zeros(3)))
    return engine


def _exercise_sleep(engine: ParticleEngine) -> None:
    """Let particles sleep in the tray and on the ground, and disturb them."""
    points = [[0.0, -0.2, 0.28], [0.0, 0.9, 0.08], [1.0, 0.9, 0.08]]
    engine.add(points, np.zeros((3, 3)), _LITRE, grow=False)
    # This one touches another, so that there is a spring to save while they sleep.
    engine.add([1.0, 1.004, 0.08], [0.2, -0.2, 0.0], _LITRE, grow=False)
    engine.step(_STEP)
    engine.add([0.0, 0.9, 0.25], [0.0, 0.0, -3.0], _LITRE, grow=False)
    for k in range(20):
        start, end = np.array([0.0, 0.0, -0.001 * k]), np.array([0.0, 0.0, -0.001 * (k + 1)])
        engine.set_tool_motion(0, (np.eye(3), start), (np.eye(3), end))
        engine.ground.set_heights(np.array([2]), np.array([2]), np.array([0.001 * k]))
        engine.step(_STEP)
        engine.settled()
    engine.add([0.0, -0.2, 0.5], np.zeros(3), _LITRE)
    engine.step(_STEP)
