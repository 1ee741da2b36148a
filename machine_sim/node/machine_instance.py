"""One machine of a node: its specification, parameters and command arbiter."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from machine_sim.commands import TRACK_NAMES, CommandArbiter, CommandParams
from machine_sim.machine import (
    MachineSpec,
    TrackModel,
    find_shapes_file,
    load_machine_spec,
    with_track_model,
)
from machine_sim.node.params import MachineInstanceParams
from machine_sim.simulated_machine import Placement
from msg_bridge.config_files import find_config
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.input_files import InputFile, read_input_file

__all__ = [
    "MachineInstance",
    "create_machine_instances",
    "describe_machines",
    "find_input_files",
]


@dataclass(frozen=True, eq=False)
class MachineInstance:
    """One machine of a node, independent of a run.

    Attributes:
        params: parameters of this machine.
        spec: dimensions, masses and limits.
        arbiter: arbiter of its commands.
        name: name among the machines of the node; empty for the only one.
    """

    params: MachineInstanceParams
    spec: MachineSpec
    arbiter: CommandArbiter
    name: str = ""

    @property
    def topic_prefix(self) -> str:
        """Prefix of the machine's topics and diagnostics keys."""
        return f"{self.name}/" if self.name else ""

    def frame_prefix(self, namespace: str) -> str:
        """Return the prefix of the machine's frames in a node with a namespace."""
        name = self.name or namespace.strip("/")
        return self.params.frame_prefix or (f"{name}/" if name else "")

    @property
    def placement(self) -> Placement:
        """The machine and its initial pose."""
        params = self.params
        return Placement(self.spec, (params.x, params.y), math.radians(params.yaw))

    @property
    def command_names(self) -> tuple[str, ...]:
        """Names of the actuators: joints, then tracks."""
        return (*self.spec.joint_names, *TRACK_NAMES)


def find_input_files(instances: Iterable[MachineInstance]) -> tuple[InputFile, ...]:
    """Return the machine files of a node's machines, and the files of shapes that they name.

    Raises:
        ConfigError: a missing machine file.
        MachineError: an invalid machine file.
        OSError: a file cannot be read.
    """
    files = []
    for instance in instances:
        parameter = f"{instance.name}.machine" if instance.name else "machine"
        path = find_config(instance.params.machine)
        files.append(read_input_file(parameter, path))
        shapes = find_shapes_file(path)
        if shapes is not None:
            files.append(read_input_file(f"{parameter}.shapes", shapes))
    return tuple(files)


def create_machine_instances(
    params: Mapping[str, MachineInstanceParams], tracks: TrackModel, commands: CommandParams
) -> list[MachineInstance]:
    """Create the machines of a node from their files.

    Args:
        params: parameters of each machine, by name.
        tracks: track model of all machines.
        commands: parameters of the command inputs.

    Raises:
        ConfigError: a missing machine file.
        MachineError: an invalid machine file.
        ParameterError: two machines at the same position, or with the same frames.
    """
    instances: list[MachineInstance] = []
    for name, machine_params in params.items():
        spec = with_track_model(load_machine_spec(find_config(machine_params.machine)), tracks)
        instance = MachineInstance(machine_params, spec, CommandArbiter(spec, commands), name)
        for other in instances:
            if other.placement.position == instance.placement.position:
                raise ParameterError(
                    f"{other.name} and {name} start at the same position; set {name}.x or {name}.y"
                )
            if other.frame_prefix("") == instance.frame_prefix(""):
                raise ParameterError(
                    f"frames of {other.name} and {name} would have the same names; set"
                    f" {other.name}.frame_prefix or {name}.frame_prefix"
                )
        instances.append(instance)
    return instances


def describe_machines(machine_id: int, instances: Iterable[MachineInstance]) -> str:
    """Return the machine id and the machines of a node, for its log."""
    machines = ", ".join(
        f"{each.name} ({each.spec.name})" if each.name else each.spec.name for each in instances
    )
    return f"machine_id {machine_id}: {machines}"
