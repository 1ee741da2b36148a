"""Parameters of the machine side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from machine_sim.machine.tracks.track_model import TRACK_MODELS
from msg_bridge.contract.parameters import Parameters, parameter

__all__ = ["MachineSimParams"]


@dataclass(frozen=True)
class MachineSimParams(Parameters):
    """How the machine side steps, and how soil becomes particles and lands."""

    physics_step: float = parameter(
        0.005, "time step of machines and particles", unit="s", low=0.001, high=0.01
    )
    steps_per_tick: int = parameter(2, "physics steps in one soil tick", low=1, high=20)
    track_model: Literal["kinematic", "dynamic"] = parameter(
        "kinematic",
        "kinematic: shoes on the path of belts that cost nothing; dynamic: rigid shoes hinged to one"
        " another and driven by the sprocket, 1 ms a step",
        choices=TRACK_MODELS,
    )
    max_releases_per_tick: int = parameter(
        60, "particles made in one tick, at most; the rest of the soil waits", low=1, high=10_000
    )
    max_deposit_requests_per_tick: int = parameter(
        200, "particles landed in one tick, at most", low=1, high=100_000
    )
    payload_coupling: bool = parameter(True, "the soil in the tool weighs on the machine")
    cutting_forces: bool = parameter(True, "the soil resists the tool that cuts it, and bears it")

    @property
    def tick_period(self) -> float:
        """Length of a soil tick [s]."""
        return self.physics_step * self.steps_per_tick
