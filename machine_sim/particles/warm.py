"""Compile every kernel before the first real step."""

from __future__ import annotations

import numpy as np

from machine_sim.ground import Ground
from machine_sim.particles.engine import ParticleEngine
from machine_sim.particles.params import ParticleParams
from msg_bridge.contract.grid import Grid

__all__ = ["warm_up"]

_STEP = 0.005
_LITRE = 10**6


def warm_up(params: ParticleParams | None = None) -> None:
    """Run a tiny world through every kernel; seconds with an empty cache, else much less.

    Args:
        params: physics, as shipped if not given; several threads have kernels of their own.
    """
    engine = _tray(params.threads if params else 1)
    ids = engine.add(
        [[0.0, 0.0, 0.3], [0.0, 0.05, 0.3], [1.5, 0.0, 0.05]], np.zeros((3, 3)), _LITRE
    )
    for _ in range(12):
        engine.step(_STEP)
        engine.settled()
    engine.store.reorder(np.arange(3)[::-1])
    engine.remove(ids[:1])
    engine.step(_STEP)
    engine.store.velocity[0, 0] = 9.0
    engine.step(_STEP)
    _ = engine.max_overlap
    _rest_and_wake(engine)


def _tray(threads: int) -> ParticleEngine:
    """A tray over a small map; all that touches it falls asleep at once."""
    params = ParticleParams(threads=threads, sleep_speed=1.0, sleep_time=0.0)
    engine = ParticleEngine(params, Ground(Grid(4, 4, 1.0), np.zeros((4, 4))))
    floor = [[-0.5, -0.5, 0.2], [0.5, -0.5, 0.2], [0.5, 0.5, 0.2], [-0.5, 0.5, 0.2]]
    side = [[-0.5, -0.5, 0.2], [0.5, -0.5, 0.2], [0.5, -0.5, 0.8], [-0.5, -0.5, 0.8]]
    engine.add_tool(0, [floor, side], (np.eye(3), np.zeros(3)))
    return engine


def _rest_and_wake(engine: ParticleEngine) -> None:
    """Let some rest in the tray and on the ground, and disturb them."""
    nothing = np.zeros(3)
    engine.remove(engine.store.particle_id)
    engine.add([[0.0, -0.2, 0.28], [0.0, 0.9, 0.08], [1.0, 0.9, 0.08]], np.zeros((3, 3)), _LITRE,
               grow=False)  # fmt: skip
    # One that comes against another: there is a spring to keep while they rest.
    engine.add([1.0, 1.004, 0.08], [0.2, -0.2, 0.0], _LITRE, grow=False)
    engine.step(_STEP)
    engine.add([0.0, 0.9, 0.25], [0.0, 0.0, -3.0], _LITRE, grow=False)
    for k in range(20):
        low, high = np.array([0.0, 0.0, -0.001 * k]), np.array([0.0, 0.0, -0.001 * (k + 1)])
        engine.set_tool(0, (np.eye(3), low), (np.eye(3), high))
        engine.ground.update(np.array([2]), np.array([2]), np.array([0.001 * k]))
        engine.step(_STEP)
        engine.store.quiet_time[:] = 1.0
        engine.settled()
    engine.add([0.0, -0.2, 0.5], nothing, _LITRE)
    engine.step(_STEP)
