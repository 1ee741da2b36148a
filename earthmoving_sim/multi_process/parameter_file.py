"""The parameters of a run as one ROS parameter file for all its nodes."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import yaml

from earthmoving_sim.run_config import RunConfig

__all__ = ["NAMESPACE", "write_node_parameters"]

NAMESPACE = "/excavator"
"""Namespace of the machine and its operator."""

_RECORDER = "exchange_recorder"


def write_node_parameters(
    path: Path,
    config: RunConfig,
    *,
    site: Path,
    bag: Path,
    realtime: bool,
    command_interval_ticks: int,
    command_delay_ticks: int,
) -> None:
    """Write the parameters of every node of a run.

    Args:
        path: file to write.
        config: parameters of the run.
        site: terrain file.
        bag: folder to record into.
        realtime: whether ticks follow the wall clock; else as fast as possible, and repeatable.
        command_interval_ticks: ticks between commands of the operator in lockstep.
        command_delay_ticks: ticks from an observation until the command takes effect in lockstep.
    """
    tick_period = config.stepping.tick_period
    soil = {
        "tick_period": tick_period,
        "sync": "realtime" if realtime else "lockstep",
        "required_subscribers": [_RECORDER],
        "map_rate": 0.5,
        "site": {"terrain": str(site.resolve())},
        "soil": asdict(config.soil),
    }
    machine = {
        "machine": str(config.machine_file),
        "x": config.run.start_x - config.task.approach_distance,
        "y": config.run.start_y,
        "seed": config.run.seed,
        "command_wait_period": 0 if realtime else command_interval_ticks,
        "command_delay": command_delay_ticks,
        "required_subscribers": [_RECORDER],
        "state_rate": 1.0 / (command_interval_ticks * tick_period),
        "stepping": asdict(config.stepping),
        "particles": asdict(config.particles),
    }
    operator = {
        "machine": str(config.machine_file),
        "behaviour": asdict(config.behaviour),
        "task": asdict(config.task),
    }
    recorder = {"path": str(bag.resolve()), "progress": False}
    nodes = {
        "/soil_sim": soil,
        f"{NAMESPACE}/machine_sim": machine,
        f"{NAMESPACE}/dig_operator": operator,
        f"/{_RECORDER}": recorder,
    }
    content: dict[str, Any] = {name: {"ros__parameters": values} for name, values in nodes.items()}
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
