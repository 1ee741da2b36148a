"""Compile every kernel before the first real step."""

from __future__ import annotations

import numpy as np

from machine_sim.dem.engine import ParticleEngine
from machine_sim.dem.params import ParticleParams
from machine_sim.ground.contact_surface import Ground
from msg_bridge.contract.grid import Grid

__all__ = ["warm_up"]

_STEP = 0.005
_LITRE = 10**6


def warm_up(params: ParticleParams | None = None) -> None:
    """Run a tiny world through every kernel; seconds with an empty cache, else much less.

    Args:
        params: physics, as shipped if not given; several threads have kernels of their own.
    """
    engine = _box_scene(params.threads if params else 1)
    ids = engine.add(
        [[0.0, 0.0, 0.3], [0.0, 0.05, 0.3], [1.5, 0.0, 0.05]], np.zeros((3, 3)), _LITRE
    )
    for _ in range(12):
        engine.step(_STEP)
        engine.settled()
    engine.state.reorder(np.arange(3)[::-1])
    engine.remove(ids[:1])
    engine.step(_STEP)
    engine.state.velocity[0, 0] = 9.0
    engine.step(_STEP)
    _ = engine.max_overlap
    _exercise_sleep(engine)


def _box_scene(threads: int) -> ParticleEngine:
    """A tray over a small map; all that touches it falls asleep at once."""
    params = ParticleParams(threads=threads, sleep_speed=1.0, sleep_time=0.0)
    engine = ParticleEngine(params, Ground(Grid(4, 4, 1.0), np.zeros((4, 4))))
    floor = [[-0.5, -0.5, 0.2], [0.5, -0.5, 0.2], [0.5, 0.5, 0.2], [-0.5, 0.5, 0.2]]
    side = [[-0.5, -0.5, 0.2], [0.5, -0.5, 0.2], [0.5, -0.5, 0.8], [-0.5, -0.5, 0.8]]
    engine.add_tool(0, [floor, side], (np.eye(3), np.zeros(3)))
    return engine


def _exercise_sleep(engine: ParticleEngine) -> None:
    """Let some rest in the tray and on the ground, and disturb them."""
    nothing = np.zeros(3)
    engine.remove(engine.state.particle_id)
    engine.add([[0.0, -0.2, 0.28], [0.0, 0.9, 0.08], [1.0, 0.9, 0.08]], np.zeros((3, 3)), _LITRE,
               grow=False)  # fmt: skip
    # One that comes against another: there is a spring to keep while they rest.
    engine.add([1.0, 1.004, 0.08], [0.2, -0.2, 0.0], _LITRE, grow=False)
    engine.step(_STEP)
    engine.add([0.0, 0.9, 0.25], [0.0, 0.0, -3.0], _LITRE, grow=False)
    for k in range(20):
        low, high = np.array([0.0, 0.0, -0.001 * k]), np.array([0.0, 0.0, -0.001 * (k + 1)])
        engine.set_tool_motion(0, (np.eye(3), low), (np.eye(3), high))
        engine.ground.set_heights(np.array([2]), np.array([2]), np.array([0.001 * k]))
        engine.step(_STEP)
        engine.state.settle_timer[:] = 1.0
        engine.settled()
    engine.add([0.0, -0.2, 0.5], nothing, _LITRE)
    engine.step(_STEP)
