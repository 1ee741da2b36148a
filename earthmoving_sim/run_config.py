"""RunConfig: the parameters of a run of the scripted operator, all parts together."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dig_operator import BehaviourParams, DigTaskParams, HaulTaskParams
from earthmoving_sim.config_layers import (
    SECTIONS,
    ConfigLayer,
    RunParams,
    TruckParams,
    merge_layers,
    read_layer,
)
from machine_sim.dem import ParticleParams
from machine_sim.machine import MachineSpec, load_machine_spec
from machine_sim.params import MachineSimParams
from msg_bridge.config_files import find_config
from msg_bridge.contract.errors import ParameterError
from soil_sim.soils.params import SoilParams

__all__ = ["RunConfig", "RunParams", "load_run_config"]

_BASE = "demo.yaml"
"""Shipped file whose parameters hold where no other layer names them."""

_SITE = "/site/"
"""Namespace of the machine node of an excavator and a truck."""

_DEFAULT_MACHINE = "machines/excavator.yaml"


@dataclass(frozen=True)
class RunConfig:
    """Parameters of a run.

    Attributes:
        machine: the excavator.
        machine_file: the file that describes it.
        soil: soil of the site.
        particles: particles in and around the bucket.
        stepping: time steps and track model of the machine.
        behaviour: behaviour of the operator.
        task: task of the operator.
        truck_machine: the dumper that the excavator loads; None if it dumps on the ground.
        truck_file: the file that describes it.
        truck: initial pose of the dumper.
        haul: task of the dumper's operator.
        run: seed and start position.
        unused: parameters of nodes in the file that a run does not use.
    """

    machine: MachineSpec
    machine_file: Path
    soil: SoilParams
    particles: ParticleParams
    stepping: MachineSimParams
    behaviour: BehaviourParams
    task: DigTaskParams
    run: RunParams
    truck_machine: MachineSpec | None
    truck_file: Path
    truck: TruckParams
    haul: HaulTaskParams
    unused: tuple[str, ...] = ()

    @property
    def soil_description(self) -> str:
        """Kind of soil of the ground, or angle of repose and swell of a soil without a name."""
        soil = self.soil
        if soil.soil:
            return soil.soil
        return f"repose angle {soil.repose_angle:g} deg, swell {soil.swell:g}, no cohesion"


def load_run_config(
    overlay: str | Path = _BASE,
    overrides: Mapping[str, Any] | None = None,
    *,
    soil: str = "",
    base: str = _BASE,
) -> RunConfig:
    """Load `config/demo.yaml`, and change what files and the arguments name.

    Args:
        overlay: a path or the name of a shipped file, in the demo's or in the nodes' format.
        overrides: values of parameters of the sections `task` and `run`, by name.
        soil: kind of soil of the ground; empty keeps that of the files.
        base: a shipped file that is read before the overlay.

    Raises:
        ConfigError: a file is missing.
        ParameterError: a file is not valid, or a parameter is unknown or out of range; also if
            there is no soil of that name.
        MachineError: the machine file is not valid.
    """
    path = find_config(str(overlay))
    layers = [read_layer(find_config(name)) for name in dict.fromkeys((_BASE, base))]
    layers.append(read_layer(path))
    if soil:
        layers.append(ConfigLayer({"soil": {"soil": soil}}))
    layers.append(_override_layer(overrides or {}))
    merged = merge_layers(*layers)
    try:
        parts: dict[str, Any] = {
            section: kind.from_mapping(merged.sections[section], prefix=f"{section}.")
            for section, kind in SECTIONS.items()
        }
        parts["soil"].soil_types()
        if parts["task"].truck:
            parts["haul"] = _common_haul(parts["task"], parts["haul"], merged.sections["haul"])
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}" if str(overlay) != _BASE else str(error)) from error
    machine_file = find_config(merged.machine or _DEFAULT_MACHINE).resolve()
    truck_file = find_config(parts["truck"].file).resolve()
    return RunConfig(
        machine=load_machine_spec(machine_file),
        machine_file=machine_file,
        truck_machine=load_machine_spec(truck_file) if parts["task"].truck else None,
        truck_file=truck_file,
        unused=merged.unused,
        **parts,
    )


def _common_haul(
    task: DigTaskParams, haul: HaulTaskParams, named: Mapping[str, Any]
) -> HaulTaskParams:
    """Return the dumper's task with loads, fill and duration of the excavator's.

    Args:
        task: task of the excavator.
        haul: task of the dumper.
        named: parameters of the dumper's task that a file names.

    Raises:
        ParameterError: the tasks differ, or the namespace of the truck cannot be used.
    """
    if not task.truck.startswith(_SITE) or task.truck in (_SITE, f"{_SITE}digger"):
        raise ParameterError(
            f"task.truck is {task.truck!r}; a run has the namespaces {_SITE}digger and {_SITE}NAME"
        )
    if haul.loader not in ("", f"{_SITE}digger"):
        raise ParameterError(
            f"haul.loader is {haul.loader!r}; the excavator of a run is {_SITE}digger"
        )
    for name in ("loads", "full_fill", "duration"):
        if name in named and getattr(haul, name) != getattr(task, name):
            raise ParameterError(
                f"haul.{name} is {getattr(haul, name)} and task.{name} {getattr(task, name)}; leave"
                f" out haul.{name}, which is that of the task"
            )
    return replace(haul, loads=task.loads, full_fill=task.full_fill, duration=task.duration)


def _override_layer(overrides: Mapping[str, Any]) -> ConfigLayer:
    """Return overrides by name as a layer of the sections `task` and `run`."""
    sections: dict[str, dict[str, Any]] = {"task": {}, "run": {}}
    for name, value in overrides.items():
        is_run = name in RunParams.__dataclass_fields__
        sections["run" if is_run else "task"][name] = value
    return ConfigLayer(sections)
