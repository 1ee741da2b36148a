"""A machine of a world with its operator at the levers."""

from __future__ import annotations

from typing import Protocol

from dig_operator import Command, Observation
from dig_operator.observation_builder import ObservationBuilder, TerrainSnapshot
from earthmoving_sim.world import World
from machine_sim.simulated_machine import SimulatedMachine
from msg_bridge.codec.machine_state import BaseState, PayloadState
from msg_bridge.codec.poses import odometry_round_trip

__all__ = ["MachineOperator", "OperatedMachine"]


class MachineOperator(Protocol):
    """Whoever answers what is seen with a command."""

    def command(self, observation: Observation, dt: float) -> Command:
        """What to do in the next `dt` [s]."""


class OperatedMachine:
    """One machine, who operates it, and what is seen from its cab."""

    def __init__(
        self, world: World, rig: SimulatedMachine, operator: MachineOperator, tick: float
    ) -> None:
        """
        Args:
            world: that it is in.
            rig: the machine.
            operator: at its levers.
            tick: length of a tick [s].
        """
        self._world, self._rig, self._operator, self._tick = world, rig, operator, tick
        self._observation_builder = ObservationBuilder()

    def observation(self) -> Observation:
        """What the public topics would tell, bit by bit."""
        world, machine = self._world, self._rig.machine
        base, payload = BaseState(*machine.base_pose, *machine.base_velocity), self._rig.payload
        return self._observation_builder.build(
            world.tick * self._tick,
            machine.joint_positions,
            odometry_round_trip(base),
            PayloadState(payload.bank, payload.loose, payload.mass, payload.fill),
            TerrainSnapshot(world.soil.grid, world.surface, world.soil.revision),
            world.ledger,
        )

    def observe_and_command(self, dt: float) -> None:
        """Look, and command the machine for the next `dt` [s]."""
        command = self._operator.command(self.observation(), dt)
        self._rig.machine.command(command.joints, command.tracks)
