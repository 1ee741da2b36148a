"""Outcome: what a run of the operator did, whoever watched it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dig_operator import CycleReport
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.ledger import Ledger
from soil_sim.terrain import HeightMap

__all__ = ["PATH_INTERVAL_TICKS", "DigOutcome"]

PATH_INTERVAL_TICKS = 10
"""Ticks between points of the path of the lip."""


@dataclass
class DigOutcome:
    """What a run did.

    Attributes:
        site: the terrain before.
        after, loose_depth: surface and depth of loose soil after [m], shape (rows, cols).
        cycles: one report per cycle.
        ledger: of the last tick.
        worst_imbalance: the largest of all ticks, with its sign [mm^3].
        moved: bank volume carried to the dump [m^3].
        simulated, wall: how long it took [s]; wall time without compiling.
        most_particles: largest number of live particles that was seen.
        tunnelled: particles that passed through the bucket or the ground.
        path: lip positions [m], shape (n, 3), with cycle (n,) and phase (n,).
        given_up: why the run ended before its last cycle, empty if it did not.
        state_hash: of the terrain after tick `state_tick`, the last of which it is known.
        run_mode: the parts it ran in, as `one process`.
        machine_faces, machine_outline, machine_position: the machine as it ended, for pictures.
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
    machine_faces: list[tuple[str, NDArray[np.float64]]] = field(repr=False)
    machine_outline: list[tuple[str, NDArray[np.float64]]] = field(repr=False)
    machine_position: tuple[float, float]

    @property
    def is_balanced(self) -> bool:
        """Whether no tick of a finished run lost or made soil."""
        return not self.abort_reason and self.max_imbalance == 0

    @property
    def production_rate(self) -> float:
        """Bank volume carried in an hour [m^3/h]."""
        return self.moved_volume / self.simulated_time * 3600.0

    @property
    def real_time_factor(self) -> float:
        """Simulated time in parts of wall time."""
        return self.simulated_time / self.wall_time
