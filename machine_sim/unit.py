"""A machine of a node: what it is, what is said of it, and what it is told."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from machine_sim.commands import TRACK_NAMES, CommandBoard, CommandParams
from machine_sim.machine import MachineDescription, TrackModel, fitted_with, load_description
from machine_sim.node_params import UnitParams
from machine_sim.work.rig import Placement
from msg_bridge.config_files import find_config
from msg_bridge.contract.errors import ParameterError

__all__ = ["Unit", "make_units"]


@dataclass(frozen=True, eq=False)
class Unit:
    """One machine of a node, whatever run it takes part in.

    Attributes:
        params: what is said of it by itself.
        description: dimensions, masses and limits.
        board: what it is told.
        name: among the machines of its node; empty if it is the only one.
    """

    params: UnitParams
    description: MachineDescription
    board: CommandBoard
    name: str = ""

    @property
    def folder(self) -> str:
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
        return Placement(self.description, (params.x, params.y), math.radians(params.yaw))

    @property
    def command_names(self) -> tuple[str, ...]:
        """What can be commanded: its joints, then its tracks."""
        return (*self.description.joint_names, *TRACK_NAMES)


def make_units(
    params: Mapping[str, UnitParams], tracks: TrackModel, commands: CommandParams
) -> list[Unit]:
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
    units: list[Unit] = []
    for name, own in params.items():
        description = fitted_with(load_description(find_config(own.machine)), tracks)
        unit = Unit(own, description, CommandBoard(description, commands), name)
        for other in units:
            if other.placement.position == unit.placement.position:
                raise ParameterError(
                    f"{other.name} and {name} are set down at one place; give {name}.x or {name}.y"
                )
            if other.frame_prefix("") == unit.frame_prefix(""):
                raise ParameterError(
                    f"frames of {other.name} and {name} would have one name; give"
                    f" {other.name}.frame_prefix or {name}.frame_prefix"
                )
        units.append(unit)
    return units
