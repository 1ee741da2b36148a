"""The inputs of one tick of machines, from which it can be computed again."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from machine_sim.commands import AppliedCommand, ArbiterState
from machine_sim.endpoint import MachineEndpoint
from msg_bridge.contract.messages import MachineHeader
from msg_bridge.exchange.join_state import JoinState
from msg_bridge.recovery.errors import DivergenceError
from msg_bridge.recovery.packed_messages import PackedMessage, pack_messages, unpack_messages

__all__ = ["ArbiterRecord", "ArbiterStates", "Command", "JoinRecord", "MachineTickRecord"]

ArbiterStates = tuple[ArbiterState, ...]
"""Commands in force and emergency stop of each machine."""

Command = tuple[list[float], list[float]]
"""Velocities of the joints [rad/s] and tracks [m/s] of a machine."""


class ArbiterRecord(NamedTuple):
    """The commands in force after they have changed.

    Attributes:
        states: those of each machine.
    """

    states: ArbiterStates


class JoinRecord(NamedTuple):
    """A request to join.

    Attributes:
        discards_soil: whether the machines have discarded their soil before.
    """

    discards_soil: bool

    def perform(self, endpoint: MachineEndpoint) -> None:
        """Request to join in the same session again; a session before has ended."""
        exchange = endpoint.exchange
        if exchange.join_state is not JoinState.OUT:
            exchange.abandon_session()
        if self.discards_soil:
            endpoint.discard_soil()
        endpoint.join()


class MachineTickRecord(NamedTuple):
    """The inputs of one tick.

    Attributes:
        messages: welcome and answers of the soil that were applied since the tick before, packed.
        commands: velocities of joints [rad/s] and tracks [m/s] of each machine.
        arbiters: commands in force as in `ArbiterRecord`; None if they have not changed.
        leave: whether it is the last tick of a session.
        digests_before: digests and volumes that the machines sent in the tick before.
    """

    messages: list[PackedMessage]
    commands: tuple[Command, ...]
    arbiters: ArbiterStates | None
    leave: bool
    digests_before: tuple[int, ...]

    @classmethod
    def of(
        cls,
        endpoint: MachineEndpoint,
        commands: Iterable[AppliedCommand],
        *,
        arbiters: ArbiterStates | None,
        leave: bool,
    ) -> MachineTickRecord:
        """Return the record of the tick that an endpoint is about to perform."""
        digests = _digests(endpoint.exchange.last_sent)
        velocities = tuple((each.joints.tolist(), each.tracks.tolist()) for each in commands)
        messages = pack_messages(endpoint.applied_messages)
        return cls(messages, velocities, arbiters, leave, digests)

    def perform(self, endpoint: MachineEndpoint) -> None:
        """Perform the tick.

        Args:
            endpoint: in the state after the tick before.

        Raises:
            DivergenceError: it is not in that state.
            ExchangeError: a message violates the protocol.
        """
        if _digests(endpoint.exchange.last_sent) != self.digests_before:
            raise DivergenceError(endpoint.tick)
        for message in unpack_messages(self.messages):
            endpoint.receive(message)
        endpoint.poll()
        if not endpoint.is_ready:
            raise DivergenceError(endpoint.next_tick, "its inputs are incomplete")
        machines = endpoint.sim.simulated_machines
        for each, command in zip(machines, self.commands, strict=True):
            each.machine.command(*map(np.array, command))
        endpoint.step(leave=self.leave)

    def skip(self, endpoint: MachineEndpoint) -> None:
        """Apply the volumes of the tick without performing it; see `MachineEndpoint.skip`.

        Raises:
            MachineError: the tick takes more soil than the machines hold.
        """
        endpoint.skip(unpack_messages(self.messages))


def _digests(header: MachineHeader | None) -> tuple[int, ...]:
    """Return what a header states of its tick; empty without one."""
    if header is None:
        return ()
    digests = header.sweeps.digest, header.deposit_requests.digest
    return (*digests, header.pending_mm3, header.particles_mm3)
