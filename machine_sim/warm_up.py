"""Compile every kernel of machines and particles before the first tick."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from machine_sim.dem import ParticleParams
from machine_sim.dem import warm_up as warm_up_particles
from machine_sim.machine import MachineSpec
from machine_sim.params import MachineSimParams
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import CONVERSION, FORCE, MAP_UPDATE, empty_rows

__all__ = ["warm_up"]

_GRID = Grid(65, 65, 1.0)
_NUM_TICKS = 4
_LITRE = 10**6


def warm_up(
    machines: Sequence[MachineSpec],
    stepping: MachineSimParams | None = None,
    particles: ParticleParams | None = None,
) -> None:
    """Step machines on a small terrain; takes seconds with an empty cache, much less otherwise.

    What was compiled or loaded by a process is not done again in it.

    Args:
        machines: machines to run later.
        stepping, particles: parameters to run later; defaults if None. Those count that select
            kernels: track model, kind and threads of particles.
    """
    warm_up_particles(particles)
    for machine in machines:
        _dig(machine, stepping, particles)


@cache
def _dig(
    machine: MachineSpec, stepping: MachineSimParams | None, particles: ParticleParams | None
) -> None:
    """Let a machine stand, with soil in its first digging tool, if any, as if it had dug."""
    sim = MachineSim(
        [Placement(machine)],
        _GRID,
        np.zeros(_GRID.shape),
        params=stepping,
        particle_params=particles,
    )
    couplings = sim.simulated_machines[0].couplings.values()
    digging = [each for each in couplings if each.is_digging]
    # A particle off the map is settled: its deposit is requested.
    sim.particles.add([[2.0 * _GRID.size[0], 0.0, 0.0]], np.zeros((1, 3)), _LITRE)
    for tick in range(_NUM_TICKS):
        sim.step()
        conversions = empty_rows(CONVERSION, min(len(digging), 1))
        map_updates = empty_rows(MAP_UPDATE, 1)
        map_updates["z"] = 1e-3 * (tick + 1)  # the contact surface rises after it
        forces = empty_rows(FORCE, 1)
        if digging:
            lip = digging[0].key_points_at(ticks_ago=0)[0]
            for name, value in zip("xyz", lip, strict=True):
                conversions[name] = forces[name] = value
            forces["tool"], forces["fz"] = digging[0].tool_id, 1.0  # the tool touches soil
        conversions["volume_mm3"] = 10 * _LITRE
        sim.check_answer(conversions, map_updates, forces)
        sim.apply(conversions, map_updates, forces)
        sim.state_hash()
    sim.close()
