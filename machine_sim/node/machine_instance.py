"""A machine of a node: what it is, what is said of it, and what it is told."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from machine_sim.commands import TRACK_NAMES, CommandArbiter, CommandParams
from machine_sim.machine import MachineSpec, TrackModel, load_machine_spec, with_track_model
from machine_sim.node.params import MachineInstanceParams
from machine_sim.simulated_machine import Placement
from msg_bridge.config_files import find_config
from msg_bridge.contract.errors import ParameterError

__all__ = ["MachineInstance", "create_machine_instances"]


@dataclass(frozen=True, eq=False)
class MachineInstance:
    """One machine of a node, whatever run it takes part in.

    Attributes:
        params: what is said of it by itself.
        description: dimensions, masses and limits.
        board: what it is told.
        name: among the machines of its node; empty if it is the only one.
    """

    params: MachineInstanceParams
    spec: MachineSpec
    arbiter: CommandArbiter
    name: str = ""

    @property
    def topic_prefix(self) -> str:
        """What is put before the names of its topics, and of all that is said of it by name."""
        return f"{self.name}/" if self.name else ""

    def frame_prefix(self, namespace: str) -> str:
        """What is put before the names of its frames, in a node of some namespace."""
        name = self.name or namespace.strip("/")
        return self.params.frame_prefix or (f"{name}/" if name else "")

    @property
    def placement(self) -> Placement:
        """The machine, and where it is set down."""
        params = self.params
        return Placement(self.spec, (params.x, params.y), math.radians(params.yaw))

    @property
    def command_names(self) -> tuple[str, ...]:
        """What can be commanded: its joints, then its tracks."""
        return (*self.spec.joint_names, *TRACK_NAMES)


def create_machine_instances(
    params: Mapping[str, MachineInstanceParams], tracks: TrackModel, commands: CommandParams
) -> list[MachineInstance]:
    """The machines of a node, from their files.

    Args:
        params: what is said of each, by name.
        tracks: the kind that all have.
        commands: how commands are taken.

    Raises:
        ConfigError: a machine file that is not there.
        MachineError: one that is not good.
        ParameterError: two machines at one place, or with the same names of frames.
    """
    instances: list[MachineInstance] = []
    for name, own in params.items():
        spec = with_track_model(load_machine_spec(find_config(own.machine)), tracks)
        unit = MachineInstance(own, spec, CommandArbiter(spec, commands), name)
        for other in instances:
            if other.placement.position == unit.placement.position:
                raise ParameterError(
                    f"{other.name} and {name} are set down at one place; give {name}.x or {name}.y"
                )
            if other.frame_prefix("") == unit.frame_prefix(""):
                raise ParameterError(
                    f"frames of {other.name} and {name} would have one name; give"
                    f" {other.name}.frame_prefix or {name}.frame_prefix"
                )
        instances.append(unit)
    return instances
