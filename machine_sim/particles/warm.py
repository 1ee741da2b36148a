"""Compile every kernel before the first real step."""

from __future__ import annotations

import numpy as np

from machine_sim.ground import Ground
from machine_sim.particles.engine import ParticleEngine
from machine_sim.particles.params import ParticleParams
from msg_bridge.contract.grid import Grid

__all__ = ["warm_up"]


def warm_up(params: ParticleParams | None = None) -> None:
    """Run a tiny world through every kernel; seconds with an empty cache, else much less.

    Args:
        params: physics, as shipped if not given; several threads have kernels of their own.
    """
    params = ParticleParams(threads=params.threads if params else 1)
    engine = ParticleEngine(params, Ground(Grid(4, 4, 1.0), np.zeros((4, 4))))
    plate = [[-0.5, -0.5, 0.2], [0.5, -0.5, 0.2], [0.5, 0.5, 0.2], [-0.5, 0.5, 0.2]]
    engine.add_tool(0, [plate], (np.eye(3), np.zeros(3)))
    ids = engine.add([[0.0, 0.0, 0.3], [0.0, 0.05, 0.3], [1.5, 0.0, 0.05]], np.zeros((3, 3)), 10**6)
    for _ in range(12):
        engine.step(0.005)
        engine.settled()
    engine.store.reorder(np.arange(3)[::-1])
    engine.remove(ids[:1])
    engine.step(0.005)
    engine.store.velocity[0, 0] = 9.0
    engine.step(0.005)
    _ = engine.max_overlap
