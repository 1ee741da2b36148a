"""Parameters of soil and machine nodes from their recorded configurations, and changes of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import yaml

from machine_sim.commands import CommandParams
from machine_sim.dem import ParticleParams
from machine_sim.node.params import BinParams, MachineInstanceParams, MachineNodeParams
from machine_sim.params import MachineSimParams
from machine_sim.sensors import SensorParams
from msg_bridge.codec.run_config import parse_section
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters
from msg_bridge.contract.suggestions import suggestion
from msg_bridge.yaml_text import load_yaml
from soil_sim.node.params import SoilNodeParams
from soil_sim.site.site import SiteParams
from soil_sim.soils.params import SoilParams

__all__ = [
    "MachineNodeSetup",
    "ParameterChange",
    "SoilNodeSetup",
    "check_changes",
    "check_changes_of_state",
    "machine_node_setup",
    "parse_change",
    "soil_node_setup",
]

P = TypeVar("P", bound=Parameters)

_SOIL_TYPE_PARAMETERS = ("repose_angle", "swell")
"""Parameters of a soil without a name; a named soil has its own."""

_FIXED = (
    *("tick_period", "sync", "overload", "expected_machines", "admit_other_machines"),
    *("machine_id", "machine_timeout", "machines", "bins", "required_subscribers"),
    *("exchange_key_file", "paused", "command_wait_period", "command_delay"),
    "stepping.steps_per_tick",
)
"""Parameters of nodes that have no effect on a replay, or would contradict its recording."""

_FIXED_IN_STATE = ("seed", "max_tool_speed", "soil.soil_depth", "particles.mode")
_FIXED_SITE = "site."
"""Parameters, and a prefix of them, that have their effect at the begin of a run."""


@dataclass(frozen=True)
class ParameterChange:
    """Another value of a parameter of a node.

    Attributes:
        node: namespace of a machine node, or `soil_sim`; empty: the nodes that have the parameter.
        name: name of the parameter as in a ROS parameter file, such as `soil.soil`.
        value: its value.
    """

    node: str
    name: str
    value: Any

    def __str__(self) -> str:
        prefix = f"{self.node}:" if self.node else ""
        return f"{prefix}{self.name}:={self.value}"


def parse_change(text: str) -> ParameterChange:
    """Parse `[NODE:]NAME:=VALUE`; the value is YAML, and 3e-1 a number.

    Raises:
        ParameterError: it has another form.
    """
    left, sign, right = text.partition(":=")
    node, _, name = left.rpartition(":")
    try:
        value = load_yaml(right)
    except yaml.YAMLError as error:
        raise ParameterError(f"the value in {text!r} is not YAML: {error}") from error
    if isinstance(value, str):  # a number to ROS, but not in YAML 1.1
        with suppress(ValueError):
            value = float(value)
    if not sign or not name or value is None:
        raise ParameterError(
            f"{text!r} is no change of a parameter; give NAME:=VALUE, for example"
            ' soil.soil:="wet clay", or NODE:NAME:=VALUE'
        )
    return ParameterChange(node, name, value)


@dataclass(frozen=True)
class SoilNodeSetup:
    """Parameters of a soil node.

    Attributes:
        node, site, soil: the parameters.
        names: names of all parameters.
        changes: the changes that were made.
    """

    node: SoilNodeParams
    site: SiteParams
    soil: SoilParams
    names: tuple[str, ...]
    changes: tuple[ParameterChange, ...]


@dataclass(frozen=True)
class MachineNodeSetup:
    """Parameters of a machine node.

    Attributes:
        node: its own parameters.
        machines: parameters of each machine by name; the name of an only machine is empty.
        bins: parameters of each bin by name.
        stepping, particles: physics.
        sensors: rate and errors of the sensors.
        commands: parameters of the command inputs; a replay does not use them.
        names: names of all parameters.
        changes: the changes that were made.
    """

    node: MachineNodeParams
    machines: dict[str, MachineInstanceParams]
    bins: dict[str, BinParams]
    stepping: MachineSimParams
    particles: ParticleParams
    sensors: SensorParams
    commands: CommandParams
    names: tuple[str, ...]
    changes: tuple[ParameterChange, ...]


class _Sections:
    """Sections of a configuration as one flat mapping, whose names are those of the parameters."""

    def __init__(self, sections: Mapping[str, Mapping[str, Any]]) -> None:
        """
        Args:
            sections: values by prefix of their names: empty, or `soil.` for example.
        """
        self._sections = {prefix: dict(values) for prefix, values in sections.items()}

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(prefix + name for prefix, values in self._sections.items() for name in values)

    def parameters(self, kind: type[P], prefix: str) -> P:
        """Return the parameters of a section.

        Raises:
            ParameterError: as of `Parameters.from_mapping`; it has the full name.
        """
        return kind.from_mapping(self._sections[prefix], prefix=prefix)

    def set(self, full_name: str, value: Any) -> bool:
        """Set a value; return False if there is no such parameter."""
        for prefix, values in self._sections.items():
            name = full_name.removeprefix(prefix)
            if full_name.startswith(prefix) and name in values:
                values[name] = value
                return True
        return False


def soil_node_setup(
    config: str, files: Mapping[str, Path], changes: Iterable[ParameterChange] = ()
) -> SoilNodeSetup:
    """Return the parameters of the soil node.

    Args:
        config: its configuration [YAML].
        files: path of each file that it has read, by parameter; see `restore_files`.
        changes: changes of parameters, of any node.

    Raises:
        ParameterError: a parameter that this version does not have, or an invalid value.
        CodecError: the configuration cannot be read.
    """
    prefixes = {"": "soil_sim", "site.": "site", "soil.": "soil"}
    sections = _Sections({p: parse_section(config, name) for p, name in prefixes.items()})
    made = _change(sections, files, changes, "soil_sim")
    if any(change.name == "soil.soil" for change in made):
        own = {change.name for change in made}
        for name in (each for each in _SOIL_TYPE_PARAMETERS if f"soil.{each}" not in own):
            sections.set(f"soil.{name}", getattr(SoilParams(), name))
    return SoilNodeSetup(
        sections.parameters(SoilNodeParams, ""),
        sections.parameters(SiteParams, "site."),
        sections.parameters(SoilParams, "soil."),
        sections.names,
        made,
    )


def machine_node_setup(
    config: str, files: Mapping[str, Path], namespace: str, changes: Iterable[ParameterChange] = ()
) -> MachineNodeSetup:
    """Return the parameters of a machine node.

    Args:
        config, files, changes: as for `soil_node_setup`.
        namespace: namespace of the node.

    Raises: as `soil_node_setup`.
    """
    own = parse_section(config, "machine_sim")
    names = list(own["machines"])
    machines = parse_section(config, "machines") if names else {}
    bins = parse_section(config, "bins")
    sections = _Sections(
        {
            "": own,
            **{f"{name}.": machines[name] for name in names},
            **{f"{name}.": values for name, values in bins.items()},
            "stepping.": parse_section(config, "stepping"),
            "particles.": parse_section(config, "particles"),
            "sensors.": parse_section(config, "sensors"),
        }
    )
    made = _change(sections, files, changes, namespace)
    node = sections.parameters(MachineNodeParams, "")
    return MachineNodeSetup(
        node,
        {name: sections.parameters(MachineInstanceParams, f"{name}.") for name in names}
        or {"": node},
        {name: sections.parameters(BinParams, f"{name}.") for name in bins},
        sections.parameters(MachineSimParams, "stepping."),
        sections.parameters(ParticleParams, "particles."),
        sections.parameters(SensorParams, "sensors."),
        CommandParams.from_mapping(parse_section(config, "commands"), prefix="commands."),
        sections.names,
        made,
    )


def check_changes(
    changes: Iterable[ParameterChange], setups: Iterable[SoilNodeSetup | MachineNodeSetup]
) -> None:
    """Check that each change is one of a parameter that a node of the run has.

    Raises:
        ParameterError: one is not.
    """
    setups = list(setups)
    names = {name for setup in setups for name in setup.names}
    for change in changes:
        if change.name in _FIXED:
            raise ParameterError(
                f"{change.name} cannot be changed: the replay has the ticks, machines and sessions"
                " of the recording"
            )
        if not any(change in setup.changes for setup in setups):
            raise ParameterError(
                f"no node of the run has the parameter of {change}{suggestion(change.name, names)}"
            )


def check_changes_of_state(changes: Iterable[ParameterChange]) -> None:
    """Check that changes have an effect in the middle of a run.

    Raises:
        ParameterError: one does not.
    """
    for change in changes:
        if change.name in _FIXED_IN_STATE or change.name.startswith(_FIXED_SITE):
            raise ParameterError(
                f"{change.name} has its effect at the begin of a run; replay it from there, without"
                " a saved state"
            )


def _change(
    sections: _Sections, files: Mapping[str, Path], changes: Iterable[ParameterChange], node: str
) -> tuple[ParameterChange, ...]:
    """Set the files that a node has read, then the changes of its parameters; return the latter."""
    for name, path in files.items():
        sections.set(name, str(path))  # a file that another one names has no parameter
    return tuple(
        change
        for change in changes
        if change.node in ("", node) and sections.set(change.name, change.value)
    )
