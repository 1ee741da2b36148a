"""What follows a replay."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from earthmoving_sim.replay.node_parameters import MachineNodeSetup
from earthmoving_sim.replay.recorded.recorded_node import NodeAction
from earthmoving_sim.replay.replayed_machines import ReplayedMachines
from earthmoving_sim.replay.replayed_soil import ReplayedSoil
from msg_bridge.contract.messages import Message, SoilHeader
from soil_sim.endpoint import SoilTickResult

__all__ = ["Observer"]


class Observer(Protocol):
    """What follows a replay, for example to record it."""

    def start_soil(self, soil: ReplayedSoil) -> None:
        """Follow a run that begins."""

    def start_machines(
        self, machines: ReplayedMachines, setup: MachineNodeSetup, first_session: int
    ) -> None:
        """Follow a machine node that enters the run, and the number of its first session."""

    def on_soil_tick(
        self, header: SoilHeader, done: SoilTickResult, messages: Sequence[Message]
    ) -> None:
        """Follow a tick of the soil and what the soil sends in it."""

    def on_action(
        self, machines: ReplayedMachines, action: NodeAction, messages: Sequence[Message]
    ) -> None:
        """Follow a join request or a tick of a machine node, and what it sends."""

    def on_state(self, machines: ReplayedMachines) -> None:
        """Follow machines that have applied all answers on which their next tick is based."""
