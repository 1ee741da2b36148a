"""DigOutcome: outcome of a run of the operator, in one process or with nodes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dig_operator import CycleReport, LoadReport
from earthmoving_sim.coloured_mesh import ColouredMesh
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.ledger import Ledger
from soil_sim.terrain import HeightMap

__all__ = ["PATH_INTERVAL_TICKS", "DigOutcome"]

PATH_INTERVAL_TICKS = 10
"""Ticks between points of the lip's path."""


@dataclass
class DigOutcome:
    """Outcome of a run.

    Attributes:
        site: terrain before the run.
        grid: grid of the terrain.
        after: height of the terrain after the run [m], shape (rows, cols).
        loose_depth: depth of loose soil after the run [m], shape (rows, cols).
        cycles: one report per cycle.
        ledger: ledger of the last tick.
        max_imbalance: imbalance of largest magnitude of all ticks [mm^3], with its sign.
        moved_volume: bank volume carried to the dump [m^3].
        simulated_time: simulation time [s].
        wall_time: wall time, without compiling [s].
        max_particles: largest number of particles.
        tunnelled: number of particles that passed through the bucket or the ground.
        abort_reason: why the task was aborted; empty if it was not.
        state_hash: SHA-256 of the terrain after tick `state_tick` [hex].
        state_tick: last tick of which the hash is known.
        run_mode: how the run was made, such as `one process`.
        lip_path: positions of the lip [m], map frame, shape (n, 3).
        lip_cycle: cycle of each position, shape (n,).
        lip_phase: phase of each position, shape (n,).
        machine_mesh: triangles of the machine at the end, map frame.
        machine_outline: name and plan-view polygon (k, 2) [m] of its parts at the end.
        machine_position: x and y of the excavator's base at the end [m].
        loads: one report per load of a truck.
    """

    site: HeightMap
    grid: Grid
    after: NDArray[np.float64]
    loose_depth: NDArray[np.float64]
    cycles: list[CycleReport]
    ledger: Ledger
    max_imbalance: int
    moved_volume: float
    simulated_time: float
    wall_time: float
    max_particles: int
    tunnelled: int
    abort_reason: str
    state_hash: str
    state_tick: int
    run_mode: str
    lip_path: NDArray[np.float64] = field(repr=False)
    lip_cycle: NDArray[np.int64] = field(repr=False)
    lip_phase: NDArray[np.str_] = field(repr=False)
    machine_mesh: ColouredMesh = field(repr=False)
    machine_outline: list[tuple[str, NDArray[np.float64]]] = field(repr=False)
    machine_position: tuple[float, float]
    loads: list[LoadReport] = field(default_factory=list)

    @property
    def is_successful(self) -> bool:
        """Whether the task was finished and the ledger was balanced at every tick."""
        return not self.abort_reason and self.max_imbalance == 0

    @property
    def production_rate(self) -> float:
        """Bank volume carried over the sum of the cycles' durations [m^3/h]; 0 without a cycle.

        Approach, changes of station and the end of the run are not part of a cycle; waits for a
        truck are.
        """
        duration = sum(cycle.duration for cycle in self.cycles)
        return self.moved_volume / duration * 3600.0 if duration > 0.0 else 0.0

    @property
    def loading_rate(self) -> float:
        """Bank volume hauled over the time in which the truck was loaded [m^3/h]; 0 without one.

        The excavator's wait for the truck is not part of it.
        """
        duration = sum(load.loading_time for load in self.loads)
        hauled = sum(load.hauled_volume for load in self.loads)
        return hauled / duration * 3600.0 if duration > 0.0 else 0.0

    @property
    def spilled_fraction(self) -> float:
        """Fraction of the bank volume dumped that was not hauled away; 0 without a truck."""
        if not self.loads or self.moved_volume <= 0.0:
            return 0.0
        return 1.0 - sum(load.hauled_volume for load in self.loads) / self.moved_volume

    @property
    def real_time_factor(self) -> float:
        """Simulation time over wall time."""
        return self.simulated_time / self.wall_time
