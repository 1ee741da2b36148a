"""The parameters of a run, all parts together, from one YAML file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import yaml

from dig_operator import BehaviourParams, DigTaskParams
from machine_sim.dem import ParticleParams
from machine_sim.machine import MachineSpec, load_machine_spec
from machine_sim.params import MachineSimParams
from msg_bridge.config_files import find_config
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.parameters import Parameters, parameter
from soil_sim.soils.params import SoilParams

__all__ = ["RunConfig", "RunParams", "load_run_config"]


@dataclass(frozen=True)
class RunParams(Parameters):
    """Where a run of the scripted operator begins."""

    seed: int = parameter(0, "of the scatter of released soil", low=0, high=2**31)
    start_x: float = parameter(-4.0, "where it digs from, map x", unit="m", low=-1e4, high=1e4)
    start_y: float = parameter(0.0, "where it digs from, map y", unit="m", low=-1e4, high=1e4)


@dataclass(frozen=True)
class RunConfig:
    """Everything a run is made of.

    Attributes:
        machine: the excavator.
        machine_file: the file that describes it.
        soil, particles, stepping, operator, shift, run: parameters of the parts.
    """

    machine: MachineSpec
    machine_file: Path
    soil: SoilParams
    particles: ParticleParams
    stepping: MachineSimParams
    behaviour: BehaviourParams
    task: DigTaskParams
    run: RunParams


_SECTIONS: dict[str, type[Parameters]] = {
    "soil": SoilParams,
    "particles": ParticleParams,
    "stepping": MachineSimParams,
    "behaviour": BehaviourParams,
    "task": DigTaskParams,
    "run": RunParams,
}


def load_run_config(name: str | Path, overrides: Mapping[str, Any] | None = None) -> RunConfig:
    """Read a file like `config/demo.yaml`.

    Args:
        name: a path, or the name of a shipped file.
        asked: values that stand above those of the sections `shift` and `run`.

    Raises:
        ConfigError: there is no such file.
        ParameterError: it is not a mapping of known sections, or a parameter is not good.
        MachineError: the machine it names is not good.
    """
    path = find_config(str(name))
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, ValueError) as error:  # ValueError: no text, or no such date
        raise ParameterError(f"{path} is not YAML: {error}") from error
    content = {} if content is None else content
    known = {"machine", *_SECTIONS}
    if not isinstance(content, Mapping) or not set(content) <= known:
        extra = "no sections"
        if isinstance(content, Mapping):
            extra = "the unknown " + ", ".join(sorted(map(str, set(content) - known)))
        raise ParameterError(f"{path} has {extra}; its sections are {', '.join(sorted(known))}")
    parts: dict[str, Any] = {}
    for section, kind in _SECTIONS.items():
        parts[section] = _section_params(path, section, kind, content.get(section))
    for section in ("task", "run"):
        own = asdict(parts[section])
        above = {name: value for name, value in (overrides or {}).items() if name in own}
        parts[section] = _SECTIONS[section].from_mapping({**own, **above})
    machine_file = find_config(str(content.get("machine", "machines/excavator.yaml"))).resolve()
    return RunConfig(machine=load_machine_spec(machine_file), machine_file=machine_file, **parts)


def _section_params(path: Path, section: str, kind: type[Parameters], values: Any) -> Parameters:
    """The parameters of one section; none given are all defaults."""
    values = {} if values is None else values
    if not isinstance(values, Mapping):
        raise ParameterError(f"{path}: {section} is {values!r}; give a mapping of parameters")
    try:
        return kind.from_mapping({str(name): value for name, value in values.items()})
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from error
