"""Parameters of the machine simulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from machine_sim.machine.tracks.track_model import TRACK_MODELS
from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["MAX_STEPS_PER_TICK", "MachineSimParams"]

MAX_STEPS_PER_TICK = 20
"""Maximum number of physics steps in a tick."""


@dataclass(frozen=True)
class MachineSimParams(Parameters):
    """Stepping of the machine simulation, and limits on released and deposited particles."""

    physics_step: float = parameter(
        0.005, "time step of machines and particles", unit="s", low=0.001, high=0.01
    )
    steps_per_tick: int = parameter(
        2,
        "number of physics steps in a tick",
        low=1,
        high=MAX_STEPS_PER_TICK,
        determined_by="stepping.physics_step and the tick_period of the soil node",
    )
    track_model: Literal["kinematic", "dynamic"] = parameter(
        "kinematic",
        "kinematic: shoes follow the path of the belt; dynamic: rigid shoes hinged to each other"
        " and driven by the sprocket, 0.6 ms of computation per step",
        choices=TRACK_MODELS,
    )
    max_releases_per_tick: int = parameter(
        60,
        "maximum number of particles released in a tick; the rest stays pending",
        low=1,
        high=10_000,
    )
    max_deposit_requests_per_tick: int = parameter(
        200, "maximum number of deposit requests in a tick", low=1, high=100_000
    )
    payload_coupling: bool = parameter(
        True, "apply the weight of the soil in a tool to the machine"
    )
    cutting_forces: bool = parameter(
        True, "apply resistance to cutting and bearing reaction to the machine"
    )

    @property
    def tick_period(self) -> float:
        """Period of a tick of the soil [s]."""
        return self.physics_step * self.steps_per_tick
