"""ObservationBuilder: combines the messages of one tick into an Observation."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dig_operator.observation import Observation
from dig_operator.observed_machine import ObservedMachine
from machine_sim.machine import MachineSpec
from machine_sim.machine.rotations import rotation_matrix
from msg_bridge.codec.machine_state import BasePose, BaseState, PayloadState
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.ledger import Ledger

__all__ = ["MachineSample", "ObservationBuilder", "TerrainSnapshot", "observed_machine"]


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


class MachineSample(NamedTuple):
    """Messages of one machine at the end of a tick.

    Attributes:
        joints: joint angles [rad], shape (joints,).
        base: pose of the base; its motion is not used.
        payload: soil in its tools.
    """

    joints: ArrayLike
    base: BasePose | BaseState
    payload: PayloadState


def observed_machine(
    name: str, spec: MachineSpec, sample: MachineSample, velocity: ArrayLike
) -> ObservedMachine:
    """Return another machine from its messages.

    Args:
        name: namespace of its topics.
        spec: its machine file.
        sample: its state.
        velocity: velocity of its base [m/s], shape (3,).
    """
    return ObservedMachine(
        name=name,
        spec=spec,
        base_position=np.array(sample.base.position, dtype=np.float64),
        base_rotation=rotation_matrix(sample.base.quaternion),
        joints=np.array(sample.joints, dtype=np.float64),
        speed=float(np.linalg.norm(np.asarray(velocity, dtype=np.float64))),
        fill=sample.payload.fill,
        bank_m3=sample.payload.bank_m3,
    )


class ObservationBuilder:
    """Builds observations and detects terrain changes from one to the next."""

    def __init__(self) -> None:
        self._revision: int | None = None

    def build(
        self,
        time: float,
        machine: MachineSample,
        terrain: TerrainSnapshot,
        ledger: Ledger,
        others: tuple[ObservedMachine, ...] = (),
    ) -> Observation:
        """Return the observation at the end of a tick.

        Soil counts as moving in the first observation, since there is none to compare it with.

        Args:
            time: simulation time [s].
            machine: state of the operated machine.
            terrain: terrain at the end of the tick.
            ledger: ledger of the tick.
            others: the other machines that the operator watches.
        """
        has_terrain_changed = terrain.revision != self._revision
        self._revision = terrain.revision
        return Observation(
            time=time,
            joints=np.array(machine.joints, dtype=np.float64),
            base_position=np.array(machine.base.position, dtype=np.float64),
            base_rotation=rotation_matrix(machine.base.quaternion),
            fill=machine.payload.fill,
            bank_m3=machine.payload.bank_m3,
            grid=terrain.grid,
            elevation=terrain.elevation,
            is_soil_moving=(has_terrain_changed or ledger.particles != 0 or ledger.in_flight != 0),
            others=others,
        )
