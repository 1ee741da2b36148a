"""A machine node of a run in its replay."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from earthmoving_sim.replay.errors import ReplayError
from earthmoving_sim.replay.node_parameters import MachineNodeSetup
from earthmoving_sim.replay.recorded.recorded_node import NodeAction
from machine_sim.commands import AppliedCommand, CommandSource
from machine_sim.node.machine_instance import MachineInstance, create_machine_instances
from machine_sim.node.machine_run import MachineRun
from machine_sim.warm_up import warm_up
from msg_bridge.codec.run_config import RunFacts
from msg_bridge.contract.messages import Keyframe, MachineHeader, Message, SoilHeader, Verb
from msg_bridge.exchange.join_state import JoinState

__all__ = ["OnState", "ReplayedMachines", "compile_kernels"]

OnState = Callable[["ReplayedMachines"], None]
"""What is called before each tick of machines."""


def compile_kernels(setup: MachineNodeSetup) -> None:
    """Compile, or load, the kernels of the machines of a node.

    Raises:
        EarthmovingError: a machine file is invalid.
    """
    specs = [each.spec for each in _instances(setup)]
    warm_up(specs, setup.stepping, setup.particles)


def _instances(setup: MachineNodeSetup) -> list[MachineInstance]:
    return create_machine_instances(setup.machines, setup.stepping.track_model, setup.commands)


def _ignore(machines: ReplayedMachines) -> None:
    """Do nothing."""


class ReplayedMachines:
    """The machines of one process of a machine node, and their end of the exchange.

    Attributes:
        namespace: namespace of the node.
        run: the machines.
    """

    def __init__(
        self,
        namespace: str,
        setup: MachineNodeSetup,
        facts: RunFacts,
        keyframe: Keyframe,
        on_state: OnState = _ignore,
    ) -> None:
        """
        Args:
            namespace: namespace of the node.
            setup: its parameters.
            facts: parameters of the run, from the soil.
            keyframe: terrain on which the machines are placed.
            on_state: called before each tick, when the answers that it is based on are applied.

        Raises:
            EarthmovingError: a machine file is invalid, or the machines have no place.
        """
        self.namespace = namespace
        instances = self.instances = _instances(setup)
        self.run = MachineRun(
            instances,
            setup.node,
            setup.stepping,
            setup.particles,
            facts,
            keyframe,
            bins=[params.spec for params in setup.bins.values()],
            session_id=0,
        )
        self._on_state = on_state
        self._inbox: deque[tuple[int, Message]] = deque()  # with the tick of the soil
        self._outbox: list[Message] = []

    def __getstate__(self) -> dict[str, Any]:
        """Return all but what follows the machines, for a saved state."""
        return {name: each for name, each in vars(self).items() if name != "_on_state"}

    def continue_from(self, other: ReplayedMachines) -> None:
        """Continue the run of machines that may have other parameters, which are closed.

        Raises:
            MachineError, ParticleError: see `MachineSim.continue_from`.
        """
        sim = other.run.sim
        self.run.continue_from(other.run)
        self._inbox, self._outbox = other._inbox, other._outbox
        sim.close()

    def continue_with(self, on_state: OnState) -> None:
        """Continue from a saved state.

        Args:
            on_state: as for `__init__`.
        """
        self._on_state = on_state

    @property
    def client_id(self) -> int:
        """Id of the physics client of the machines."""
        return self.run.sim.machine.client_id

    def receive(self, tick: int, messages: Iterable[Message]) -> None:
        """Receive what the soil sent in a tick; it is processed when it was in the recording."""
        self._inbox.extend((tick, message) for message in messages)

    def perform(self, action: NodeAction) -> MachineHeader:
        """Do what the node did, and return the header that it sends.

        Raises:
            ReplayError: it cannot be done: the recording is incomplete, or the node continued from
                a checkpoint that pybullet does not restore exactly.
            ExchangeError: a message violates the protocol.
        """
        if action.header.is_tick:
            self._step(action)
        else:
            self._join(action.header)
        sent = self.run.endpoint.drain_outbox()
        self._outbox += sent
        header = sent[-1]
        assert isinstance(header, MachineHeader), "the header comes after its rows"
        return header

    @property
    def unsent_messages(self) -> list[Message]:
        """The messages to the soil that are not taken yet, in order."""
        return list(self._outbox)

    def applied_commands(self, action: NodeAction) -> list[AppliedCommand]:
        """Return the command of each machine in a tick; its source is not known.

        Raises:
            ReplayError: a command has values of other joints than the machine has.
        """
        commands = []
        for instance, values in zip(self.instances, action.commands, strict=True):
            if values.keys() != set(instance.command_names):
                raise ReplayError(
                    f"a command of {self.namespace} in tick {action.header.tick} is of"
                    f" {', '.join(values) or 'nothing'}; its machine has"
                    f" {', '.join(instance.command_names)}"
                )
            num_joints = len(instance.spec.joint_names)
            velocities = np.array([values[name] for name in instance.command_names])
            joints, tracks = velocities[:num_joints], velocities[num_joints:]
            unknown: CommandSource = "none"
            sources = (unknown,) * num_joints, (unknown,) * 2
            commands.append(AppliedCommand(joints, tracks, *sources))
        return commands

    def take_messages(self) -> list[Message]:
        """Return the messages to the soil, in order, and remove them."""
        messages, self._outbox = self._outbox, []
        return messages

    def finish(self) -> None:
        """Apply the last answer that has arrived."""
        endpoint = self.run.endpoint
        while self._inbox:
            endpoint.receive(self._inbox.popleft()[1])
        if endpoint.exchange.waiting and endpoint.poll() is not None:
            self._on_state(self)

    def close(self) -> None:
        """Release the physics engine."""
        self.run.close()

    def _join(self, header: MachineHeader) -> None:
        endpoint = self.run.endpoint
        exchange = endpoint.exchange
        self._apply_answer(header.tick)
        if header.tick < exchange.tick:
            raise ReplayError(
                f"{self.namespace} was restarted and rejoins from a checkpoint, with the soil's"
                f" answers up to tick {header.tick} instead of {exchange.tick}; the poses and the"
                " soil of a checkpoint are not in the bag, so later ticks are not compared"
            )
        if exchange.join_state is not JoinState.OUT:
            exchange.abandon_session()
        if header.verb is Verb.JOIN and exchange.tick >= 0:
            endpoint.discard_soil()
        exchange.session_id = header.session_id - 1  # the session before, from which it counts on
        endpoint.join()

    def _step(self, action: NodeAction) -> None:
        header = action.header
        self._process_inbox(header.answered_tick)
        endpoint = self.run.endpoint
        endpoint.poll()
        if not endpoint.is_ready:
            raise ReplayError(
                f"{self.namespace} cannot make tick {header.tick}: it is"
                f" {endpoint.exchange.join_state.value}, and lacks answers of the soil; the bag is"
                " incomplete"
            )
        self._on_state(self)
        simulated = self.run.sim.simulated_machines
        for each, command in zip(simulated, self.applied_commands(action), strict=True):
            each.machine.command(command.joints, command.tracks)
        self.run.step(leave=header.verb is Verb.LEAVE)

    def _apply_answer(self, tick: int) -> None:
        """Apply the answer of the soil's tick `tick`, unless it is applied."""
        endpoint = self.run.endpoint
        if tick > endpoint.exchange.tick and endpoint.exchange.joined:
            self._process_inbox(tick)
            endpoint.poll()

    def _process_inbox(self, tick: int) -> None:
        """Process the messages that the soil sent up to a tick, from which the answer came.

        A header of a tick before it was replaced by that one, or did not arrive; with it, a machine
        that skips ticks would apply the answer in two parts.
        """
        endpoint = self.run.endpoint
        is_waiting = endpoint.exchange.join_state is JoinState.WAITING
        while self._inbox and self._inbox[0][0] <= tick:
            number, message = self._inbox.popleft()
            if is_waiting and number < tick and isinstance(message, SoilHeader):
                continue
            endpoint.receive(message)
