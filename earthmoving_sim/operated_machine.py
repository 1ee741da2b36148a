"""OperatedMachine: a machine of a world that is commanded by an operator."""

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
    """Computes commands from observations."""

    def command(self, observation: Observation, dt: float) -> Command:
        """Return the command for the next `dt` [s]."""


class OperatedMachine:
    """A machine, its operator, and the observations that the operator makes."""

    def __init__(
        self,
        world: World,
        machine: SimulatedMachine,
        operator: MachineOperator,
        tick_period: float,
    ) -> None:
        """
        Args:
            world: the world of the machine.
            machine: the machine.
            operator: its operator.
            tick_period: duration of a tick [s].
        """
        self._world, self._machine, self._operator = world, machine, operator
        self._tick_period = tick_period
        self._observation_builder = ObservationBuilder()

    def observation(self) -> Observation:
        """Return the observation that the public topics give, to the bits of their messages."""
        world, machine = self._world, self._machine.machine
        base, payload = BaseState(*machine.base_pose, *machine.base_velocity), self._machine.payload
        return self._observation_builder.build(
            world.tick * self._tick_period,
            machine.joint_positions,
            odometry_round_trip(base),
            PayloadState(payload.bank_m3, payload.loose_m3, payload.mass_kg, payload.fill),
            TerrainSnapshot(world.soil.grid, world.surface, world.soil.revision),
            world.ledger,
        )

    def observe_and_command(self, dt: float) -> None:
        """Observe, and command the machine for the next `dt` [s]."""
        command = self._operator.command(self.observation(), dt)
        self._machine.machine.command(command.joints, command.tracks)
