"""OtherMachines: collects the states of other machines by tick, from their topics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

from numpy.typing import ArrayLike

from dig_operator.observation_builder import MachineSample, observed_machine
from dig_operator.observed_machine import ObservedMachine
from machine_sim.machine import MachineSpec, load_machine_spec
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.machine_state import BaseState, PayloadState
from msg_bridge.codec.run_config import parse_section
from msg_bridge.config_files import find_config
from msg_bridge.contract.errors import ErrorCode, ParameterError
from msg_bridge.contract.topics import parent_namespace

__all__ = ["OtherMachines", "check_other_machines", "node_namespace"]

_MAX_KEPT_TICKS = 100
"""Maximum number of ticks with messages that are kept for a machine."""

_Message = TypeVar("_Message")

_NO_PAYLOAD = PayloadState(0.0, 0.0, 0.0, 0.0)


def node_namespace(machine: str, simulation: str) -> str:
    """Return the namespace of the node that simulates a machine: its own, or one level up.

    Args:
        machine: namespace of the machine.
        simulation: namespace of the soil node.
    """
    parent = parent_namespace(machine)
    return machine if parent == simulation else parent


def check_other_machines(names: Sequence[str], own: str) -> None:
    """Check the namespaces of the machines that an operator watches.

    Args:
        names: namespaces of the machines.
        own: namespace of the operator's machine.

    Raises:
        ParameterError: a name is not absolute, or is that of the operator's machine.
    """
    for name in names:
        if not name.startswith("/") or name.endswith("/") or len(name) < 2:
            raise ParameterError(
                f"other_machines has {name!r}; give the whole namespace of the machine, such as"
                " /site/truck"
            )
        if name == own:
            raise ParameterError(
                f"other_machines has {name!r}, the machine of this operator; name only others"
            )


@dataclass
class _Messages:
    """Messages of one machine by tick."""

    joints: dict[int, ArrayLike] = field(default_factory=dict)
    base: dict[int, BaseState] = field(default_factory=dict)
    payload: dict[int, PayloadState] = field(default_factory=dict)

    def drop_before(self, tick: int) -> None:
        """Drop the messages of earlier ticks."""
        for kept in (self.joints, self.base, self.payload):
            for each in [known for known in kept if known < tick]:
                del kept[each]


def _store(kept: dict[int, _Message], tick: int, message: _Message) -> None:
    """Keep a message of a tick, and drop the oldest of too many."""
    kept[tick] = message
    while len(kept) > _MAX_KEPT_TICKS:
        del kept[min(kept)]


class OtherMachines:
    """States of the machines that an operator watches.

    Attributes:
        names: namespaces of the machines.
    """

    def __init__(self, names: Sequence[str], simulation: str) -> None:
        """
        Args:
            names: namespaces of the machines.
            simulation: namespace of the soil node.
        """
        self.names = tuple(names)
        self._simulation = simulation
        self._specs: dict[str, MachineSpec] = {}
        self._last: dict[str, tuple[int, ObservedMachine]] = {}
        self.start_run()

    def start_run(self) -> None:
        """Discard the states of the run before."""
        self._messages = {name: _Messages() for name in self.names}
        self._last.clear()

    def node_namespace(self, name: str) -> str:
        """Return the namespace of the node that simulates a machine."""
        return node_namespace(name, self._simulation)

    def set_config(self, name: str, text: str) -> None:
        """Load the file of a machine, which the configuration of its node names.

        Raises:
            CodecError: the configuration names no machine file.
            ConfigError: the file does not exist here.
            MachineError: the file is not valid.
        """
        node = self.node_namespace(name)
        try:
            if node == name:
                file = parse_section(text, "machine_sim")["machine"]
            else:
                file = parse_section(text, "machines")[name.rpartition("/")[2]]["machine"]
        except (KeyError, TypeError) as error:
            raise CodecError(
                f"the configuration of the node {node} has no machine {name!r}: {error!r}; check"
                " `other_machines`",
                ErrorCode.VALUE,
            ) from error
        self._specs[name] = load_machine_spec(find_config(str(file)))

    def joint_names(self, name: str) -> tuple[str, ...]:
        """Return the names of a machine's joints; empty while its file is not known."""
        spec = self._specs.get(name)
        return () if spec is None else spec.joint_names

    def add_joints(self, name: str, tick: int, angles: ArrayLike) -> None:
        """Add joint angles at the end of a tick [rad]."""
        _store(self._messages[name].joints, tick, angles)

    def add_base(self, name: str, tick: int, base: BaseState) -> None:
        """Add the pose of the base at the end of a tick."""
        _store(self._messages[name].base, tick, base)

    def add_payload(self, name: str, tick: int, payload: PayloadState) -> None:
        """Add the payload at the end of a tick."""
        _store(self._messages[name].payload, tick, payload)

    def missing(self, tick: int) -> tuple[str, ...]:
        """Return the names of the machines whose state at the end of a tick is not complete."""
        return tuple(name for name in self.names if tick not in self._complete_ticks(name))

    @property
    def first_tick(self) -> int:
        """First tick of which the states of all machines can be known; 0 if there is no limit.

        States arrive in the order of ticks: those before the first that arrived are lost, for
        example because the connection was made after they were sent.
        """
        return max(
            (
                min(self._complete_ticks(name), default=0)
                for name in self.names
                if name not in self._last
            ),
            default=0,
        )

    def unseen(self) -> tuple[str, ...]:
        """Return the names of the machines of which no state is known."""
        return tuple(
            name for name in self.names if name not in self._last and not self._complete_ticks(name)
        )

    def observe(self, tick: int, tick_period: float) -> tuple[ObservedMachine, ...]:
        """Return the newest known state of each machine up to a tick; its age is set.

        Args:
            tick: tick of the operator's own machine.
            tick_period: duration of a tick [s].
        """
        for name in self.names:
            newest = max((t for t in self._complete_ticks(name) if t <= tick), default=None)
            if newest is None:
                continue
            messages = self._messages[name]
            base, payload = messages.base[newest], messages.payload.get(newest, _NO_PAYLOAD)
            sample = MachineSample(messages.joints[newest], base, payload)
            machine = observed_machine(name, self._specs[name], sample, base.velocity)
            self._last[name] = newest, machine
            messages.drop_before(newest)
        return tuple(
            replace(machine, age=(tick - known) * tick_period)
            for known, machine in self._last.values()
        )

    def _complete_ticks(self, name: str) -> set[int]:
        """Return the ticks of which all messages of a machine are known."""
        spec, messages = self._specs.get(name), self._messages[name]
        if spec is None:
            return set()
        ticks = messages.joints.keys() & messages.base.keys()
        return ticks & messages.payload.keys() if spec.can_carry_soil else set(ticks)
