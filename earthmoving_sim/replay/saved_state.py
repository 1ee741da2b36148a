"""The state of a replay after a tick, from which it continues."""

from __future__ import annotations

from typing import NamedTuple

from earthmoving_sim.replay.node_parameters import MachineNodeSetup
from earthmoving_sim.replay.placement_terrain import PlacementTerrain
from earthmoving_sim.replay.recorded.run_survey import SessionId
from earthmoving_sim.replay.replayed_machines import OnState, ReplayedMachines
from earthmoving_sim.replay.replayed_soil import ReplayedSoil
from machine_sim.physics_state import dump_physics, next_client, restore_physics
from msg_bridge.codec.run_config import RunFacts
from msg_bridge.contract.messages import Keyframe, MachineHeader, SoilHeader

__all__ = ["SavedMachines", "SavedState"]


class SavedMachines(NamedTuple):
    """The machines of a node.

    Attributes:
        machines: the machines without their bodies.
        physics: the state of their bodies, see `dump_physics`.
        first_session: first session of the process of the node.
        newest_header: recorded header of what they did last.
    """

    machines: ReplayedMachines
    physics: bytes
    first_session: SessionId
    newest_header: MachineHeader

    @classmethod
    def of(
        cls, machines: ReplayedMachines, first_session: SessionId, newest_header: MachineHeader
    ) -> SavedMachines:
        """Return the state of machines."""
        physics = dump_physics(machines.client_id)
        return cls(machines, physics, first_session, newest_header)

    def restore(
        self, setup: MachineNodeSetup, facts: RunFacts, keyframe: Keyframe, on_state: OnState
    ) -> ReplayedMachines:
        """Make the bodies, and return the machines.

        Args:
            setup, facts, keyframe, on_state: as for `ReplayedMachines`.

        Raises:
            ValueError: the id of their physics client is taken in this process.
        """
        machines = self.machines
        with next_client(machines.client_id):
            made = ReplayedMachines(machines.namespace, setup, facts, keyframe)
        machines.run.sim.take_bodies(made.run.sim)
        restore_physics(machines.client_id, self.physics)
        machines.continue_with(on_state)
        return machines


class SavedState(NamedTuple):
    """The state of a replay.

    Attributes:
        soil: the soil.
        machines: the machine nodes that have joined, by machine id.
        terrain: terrain on which machines are placed.
        header: recorded header of the last tick.
        absent: absent soil in the recorded ledger [mm^3].
        volumes: last reported soil by session [mm^3].
    """

    soil: ReplayedSoil
    machines: dict[int, SavedMachines]
    terrain: PlacementTerrain
    header: SoilHeader
    absent: int
    volumes: dict[SessionId, int]
