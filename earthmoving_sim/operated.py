"""A machine of a world with its operator at the levers."""

from __future__ import annotations

from typing import Protocol

from earthmoving_sim.world import World
from machine_sim.operator import Command, View
from machine_sim.operator.eyes import Eyes, Terrain
from machine_sim.work.rig import Rig
from msg_bridge.codec.machine_state import BaseState, PayloadState
from msg_bridge.codec.poses import through_odometry

__all__ = ["Operated", "Operator"]


class Operator(Protocol):
    """Whoever answers what is seen with a command."""

    def command(self, view: View, dt: float) -> Command:
        """What to do in the next `dt` [s]."""


class Operated:
    """One machine, who operates it, and what is seen from its cab."""

    def __init__(self, world: World, rig: Rig, operator: Operator, tick: float) -> None:
        """
        Args:
            world: that it is in.
            rig: the machine.
            operator: at its levers.
            tick: length of a tick [s].
        """
        self._world, self._rig, self._operator, self._tick = world, rig, operator, tick
        self._eyes = Eyes()

    def view(self) -> View:
        """What the public topics would tell, bit by bit."""
        world, machine = self._world, self._rig.machine
        base, payload = BaseState(*machine.base_pose, *machine.base_velocity), self._rig.payload
        return self._eyes.see(
            world.tick * self._tick,
            machine.joint_positions,
            through_odometry(base),
            PayloadState(payload.bank, payload.loose, payload.mass, payload.fill),
            Terrain(world.soil.grid, world.surface, world.soil.revision),
            world.ledger,
        )

    def act(self, dt: float) -> None:
        """Look, and command the machine for the next `dt` [s]."""
        command = self._operator.command(self.view(), dt)
        self._rig.machine.command(command.joints, command.tracks)
