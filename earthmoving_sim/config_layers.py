"""Read the parameters of a run from a YAML file, in the demo's format or in that of the nodes.

The demo's format has a mapping for each section, as `config/demo.yaml`. The nodes' format has a
mapping for each node, as ROS parameter files have:

    soil_sim: {ros__parameters: {soil: {swell: 0.2}}}
    /**/machine_sim: {ros__parameters: {machine: machines/excavator.yaml}}

Both give a layer: a mapping of sections to the parameters that the file names. Layers are merged
in order; a later one changes only the parameters that it names.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import yaml

from dig_operator import BehaviourParams, DigTaskParams, HaulTaskParams
from machine_sim.dem import ParticleParams
from machine_sim.params import MachineSimParams
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, parameter
from msg_bridge.contract.suggestions import did_you_mean, nearest_name, suggestion
from msg_bridge.yaml_text import load_yaml
from soil_sim.soils.params import SoilParams

__all__ = ["SECTIONS", "ConfigLayer", "RunParams", "TruckParams", "merge_layers", "read_layer"]

_ROS_PARAMETERS = "ros__parameters"
_MACHINE = "machine"
"""The only parameter outside the sections: the machine file."""


@dataclass(frozen=True)
class RunParams(Parameters):
    """Start of a run of the scripted operator."""

    seed: int = parameter(0, "seed of the scatter of released soil", low=0, high=2**31)
    start_x: float = parameter(-4.0, "position to dig from, map x", unit="m", low=-1e4, high=1e4)
    start_y: float = parameter(0.0, "position to dig from, map y", unit="m", low=-1e4, high=1e4)


@dataclass(frozen=True)
class TruckParams(Parameters):
    """The dumper of a run in which the excavator loads one."""

    file: str = parameter("machines/dumper.yaml", "machine file of the dumper")
    x: float = parameter(-13.0, "initial position, map x", unit="m", low=-1e4, high=1e4)
    y: float = parameter(5.8, "initial position, map y", unit="m", low=-1e4, high=1e4)
    yaw: float = parameter(180.0, "initial heading", unit="deg", low=-360.0, high=360.0)


SECTIONS: dict[str, type[Parameters]] = {
    "soil": SoilParams,
    "particles": ParticleParams,
    "stepping": MachineSimParams,
    "behaviour": BehaviourParams,
    "task": DigTaskParams,
    "truck": TruckParams,
    "haul": HaulTaskParams,
    "run": RunParams,
}
"""Parameters of each section."""

_NODE_SECTIONS = {
    "soil_sim": ("soil",),
    "machine_sim": ("particles", "stepping"),
    "dig_operator": ("behaviour", "task"),
}
"""Sections in the parameters of each node."""

_SOIL_TYPE_PARAMETERS = ("repose_angle", "swell")
"""Parameters of a soil without a name; a named soil has its own values."""


@dataclass(frozen=True)
class ConfigLayer:
    """Parameters that a file names.

    Attributes:
        sections: parameters by section.
        machine: machine file, None if the file names none.
        unused: parameters of nodes that a run does not use, such as `soil_sim.sync`.
    """

    sections: dict[str, dict[str, Any]] = field(default_factory=dict)
    machine: str | None = None
    unused: tuple[str, ...] = ()


def merge_layers(*layers: ConfigLayer) -> ConfigLayer:
    """Return one layer in which later layers override earlier ones.

    A layer that names the kind of soil also drops repose_angle and swell of earlier layers.
    """
    sections: dict[str, dict[str, Any]] = {name: {} for name in SECTIONS}
    machine: str | None = None
    for layer in layers:
        if layer.sections.get("soil", {}).get("soil"):
            for name in _SOIL_TYPE_PARAMETERS:
                sections["soil"].pop(name, None)
        for section, values in layer.sections.items():
            sections[section].update(values)
        machine = machine if layer.machine is None else layer.machine
    return ConfigLayer(sections, machine, tuple(name for each in layers for name in each.unused))


def read_layer(path: Path) -> ConfigLayer:
    """Read a file in either format.

    Raises:
        ParameterError: the file is not YAML, has neither format, or names an unknown parameter.
    """
    try:
        content = load_yaml(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, ValueError) as error:  # ValueError: no text, or an invalid date
        raise ParameterError(f"{path} is not YAML: {error}") from error
    content = {} if content is None else content
    if not isinstance(content, Mapping):
        raise ParameterError(
            f"{path} has no sections; give a mapping of {', '.join((_MACHINE, *SECTIONS))}"
        )
    try:
        has_nodes = any(isinstance(v, Mapping) and _ROS_PARAMETERS in v for v in content.values())
        return _node_layer(content) if has_nodes else _section_layer(content)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from error


def _section_layer(content: Mapping[Any, Any]) -> ConfigLayer:
    """Return the layer of a file in the demo's format."""
    sections = {}
    for key, values in content.items():
        section = str(key)
        if section in SECTIONS:
            sections[section] = _section_values(section, values)
        elif section != _MACHINE:
            known = (_MACHINE, *SECTIONS)
            hint = suggestion(section, known) or _section_hint(section)
            raise ParameterError(
                f"unknown section {section!r}{hint}; the sections are {', '.join(known)}"
            )
    machine = content.get(_MACHINE)
    return ConfigLayer(sections, None if machine is None else str(machine))


def _section_values(section: str, values: Any) -> dict[str, Any]:
    """Return the parameters of a section, all of which are known."""
    values = {} if values is None else values
    if not isinstance(values, Mapping):
        raise ParameterError(f"{section} is {values!r}; give a mapping of parameters")
    known = _parameter_names(SECTIONS[section])
    for name in map(str, values):
        if name not in known:
            hint = _section_hint(name, section)
            raise ParameterError(
                f"unknown parameter {name!r} in section {section}{hint}; the section has"
                f" {', '.join(known)}"
            )
    return {str(name): value for name, value in values.items()}


def _section_hint(name: str, section: str | None = None) -> str:
    """Return a hint at the nearest known parameter and its section; the named section first."""
    others = [each for each in SECTIONS if each != section]
    for each in ([section] if section else []) + others:
        nearest = nearest_name(name, _parameter_names(SECTIONS[each]))
        if nearest:
            return did_you_mean(nearest, f" in section {each}")
    return ""


def _parameter_names(kind: type[Parameters]) -> list[str]:
    return [each.name for each in fields(kind)]


def _node_layer(content: Mapping[Any, Any]) -> ConfigLayer:
    """Return the layer of a file in the nodes' format."""
    sections: dict[str, dict[str, Any]] = {}
    machine: str | None = None
    unused: list[str] = []
    nodes = [str(key).rpartition("/")[2] for key in content]
    for node in _NODE_SECTIONS:
        if nodes.count(node) > 1:
            raise ParameterError(
                f"there are {nodes.count(node)} nodes {node}; give the parameters of one"
            )
    for key, entry in content.items():
        node = str(key).rpartition("/")[2]
        values = entry.get(_ROS_PARAMETERS) if isinstance(entry, Mapping) else None
        if not isinstance(values, Mapping):
            raise ParameterError(f"{key} has no mapping {_ROS_PARAMETERS}")
        if node not in _NODE_SECTIONS:
            nearest = suggestion(node, _NODE_SECTIONS)
            if nearest or node == "**":
                raise ParameterError(
                    f"unknown node {key!r}{nearest}; the nodes are {', '.join(_NODE_SECTIONS)}"
                )
            unused.append(node)
            continue
        for name, value in _nested(values).items():
            if name in _NODE_SECTIONS[node]:
                own = _section_values(name, value)
                sections.setdefault(name, {}).update(own)
            elif name == _MACHINE:
                machine = str(value)
            else:
                unused.append(f"{node}.{name}")
    return ConfigLayer(sections, machine, tuple(unused))


def _nested(values: Mapping[Any, Any]) -> dict[str, Any]:
    """Return parameters with dotted names (`soil.swell`) as mappings of mappings."""
    nested: dict[str, Any] = {}
    for name, value in _flattened(values):
        section, _, rest = name.partition(".")
        if rest:
            nested.setdefault(section, {})[rest] = value
        else:
            nested[name] = value
    return nested


def _flattened(values: Mapping[Any, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the parameters of a node with dotted names; a mapping gives its entries."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from ((f"{name}.{inner}", each) for inner, each in _flattened(value))
        else:
            yield str(name), value
