"""OperatedMachine: a machine of a world that is commanded by an operator."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from dig_operator import Command, Observation
from dig_operator.observation_builder import (
    MachineSample,
    ObservationBuilder,
    TerrainSnapshot,
    observed_machine,
)
from dig_operator.observed_machine import ObservedMachine
from earthmoving_sim.world import World
from machine_sim.simulated_machine import SimulatedMachine
from msg_bridge.codec.machine_state import BasePose, BaseState, PayloadState
from msg_bridge.codec.poses import odometry_round_trip, pose_round_trip

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
        *,
        others: Mapping[str, SimulatedMachine] | None = None,
    ) -> None:
        """
        Args:
            world: the world of the machine.
            machine: the machine.
            operator: its operator.
            tick_period: duration of a tick [s].
            others: other machines that the operator watches, by name.
        """
        self._world, self._machine, self._operator = world, machine, operator
        self._tick_period = tick_period
        self._others = dict(others or {})
        self._observation_builder = ObservationBuilder()

    def observation(self) -> Observation:
        """Return the observation that the public topics give, to the bits of their messages."""
        world = self._world
        return self._observation_builder.build(
            world.tick * self._tick_period,
            _sample(self._machine, pose_round_trip(*self._machine.machine.base_pose)),
            TerrainSnapshot(world.soil.grid, world.surface, world.soil.revision),
            world.ledger,
            tuple([_observe(name, each) for name, each in self._others.items()]),
        )

    def observe_and_command(self, dt: float) -> None:
        """Observe, and command the machine for the next `dt` [s]."""
        command = self._operator.command(self.observation(), dt)
        self._machine.machine.command(command.joints, command.tracks)


def _observe(name: str, simulated: SimulatedMachine) -> ObservedMachine:
    """Return another machine as its messages have it."""
    machine = simulated.machine
    base = odometry_round_trip(BaseState(*machine.base_pose, *machine.base_velocity))
    return observed_machine(name, machine.spec, _sample(simulated, base), base.velocity)


def _sample(simulated: SimulatedMachine, base: BasePose | BaseState) -> MachineSample:
    """Return the state of a machine as its messages have it; its base is given."""
    payload = simulated.payload
    return MachineSample(
        simulated.machine.joint_positions,
        base,
        PayloadState(payload.bank_m3, payload.loose_m3, payload.mass_kg, payload.fill),
    )
