"""The configuration of a machine node in a run, as published on `<m>/config`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict

from machine_sim.commands import CommandParams
from machine_sim.dem import ParticleParams
from machine_sim.node.machine_run import MachineRun
from machine_sim.node.params import BinParams, MachineInstanceParams, MachineNodeParams
from machine_sim.sensors import SensorParams
from msg_bridge.codec.run_config import SESSION, to_config_yaml
from msg_bridge.contract.input_files import InputFile

__all__ = ["run_config"]


def run_config(
    run: MachineRun,
    session_id: int,
    *,
    node: MachineNodeParams,
    machines: Mapping[str, MachineInstanceParams],
    bins: Mapping[str, BinParams],
    particles: ParticleParams,
    sensors: SensorParams,
    commands: CommandParams,
    input_files: Sequence[InputFile] = (),
) -> str:
    """Return the YAML text with all parameters of a machine node, and its first session of the run.

    Args:
        run: the machines in the run.
        session_id: number from which the sessions of the node count.
        node: parameters of the node.
        machines, bins: parameters of each machine and bin by name; those of an only machine are
            part of `node`, and its name is empty.
        particles, sensors, commands: the other parameters.
        input_files: files that the node has read.
    """
    named = {name: asdict(params) for name, params in machines.items() if name}
    sections = {
        SESSION: {"id": session_id, "terrain_revision": run.terrain_revision},
        "machine_sim": asdict(node),
        **({"machines": named} if named else {}),
        "bins": {name: asdict(params) for name, params in bins.items()},
        "stepping": asdict(run.sim.params),
        "particles": asdict(particles),
        "sensors": asdict(sensors),
        "commands": asdict(commands),
    }
    return to_config_yaml(run.facts, sections, input_files=input_files)
