"""ObservationBuilder: combines the messages of one tick into an Observation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dig_operator.observation import Observation
from machine_sim.machine.rotations import rotation_matrix
from msg_bridge.codec.machine_state import BaseState, PayloadState
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.ledger import Ledger

__all__ = ["ObservationBuilder", "TerrainSnapshot"]


class TerrainSnapshot(NamedTuple):
    """The terrain at the end of a tick.

    Attributes:
        grid: grid of the terrain.
        elevation: height of the terrain [m], shape (rows, cols).
        revision: number that changes with every change of the terrain.
    """

    grid: Grid
    elevation: NDArray[np.float64]
    revision: int


class ObservationBuilder:
    """Builds observations and detects terrain changes from one to the next."""

    def __init__(self) -> None:
        self._revision: int | None = None

    def build(
        self,
        time: float,
        joints: ArrayLike,
        base: BaseState,
        payload: PayloadState,
        terrain: TerrainSnapshot,
        ledger: Ledger,
    ) -> Observation:
        """Return the observation at the end of a tick.

        Soil counts as moving in the first observation, since there is none to compare it with.

        Args:
            time: simulation time [s].
            joints: angles of the machine's joints [rad], shape (joints,).
            base: pose of the base, map frame.
            payload: soil in the bucket.
            terrain: terrain at the end of the tick.
            ledger: ledger of the tick.
        """
        has_terrain_changed = terrain.revision != self._revision
        self._revision = terrain.revision
        return Observation(
            time=time,
            joints=np.array(joints, dtype=np.float64),
            base_position=np.array(base.position, dtype=np.float64),
            base_rotation=rotation_matrix(base.quaternion),
            fill=payload.fill,
            bank_m3=payload.bank_m3,
            grid=terrain.grid,
            elevation=terrain.elevation,
            is_soil_moving=(has_terrain_changed or ledger.particles != 0 or ledger.in_flight != 0),
        )
