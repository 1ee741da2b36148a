"""The parameters of a run as one ROS parameter file for all its nodes."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import yaml

from earthmoving_sim.run_config import RunConfig
from machine_sim.params import MachineSimParams
from msg_bridge.contract.parameters import node_fields

__all__ = [
    "DIGGER_NAMESPACE",
    "EXCAVATOR_NAMESPACE",
    "SITE_NAMESPACE",
    "write_node_parameters",
]

EXCAVATOR_NAMESPACE = "/excavator"
"""Namespace of an excavator without a truck, and of its operator."""

SITE_NAMESPACE = "/site"
"""Namespace of the node of an excavator and a truck."""

DIGGER_NAMESPACE = f"{SITE_NAMESPACE}/digger"
"""Namespace of the excavator beside a truck, and of its operator."""

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
    timing = {
        "command_wait_period": 0 if realtime else command_interval_ticks,
        "command_delay": command_delay_ticks,
    }
    excavator = {
        "machine": str(config.machine_file),
        "x": config.run.start_x - config.task.approach_distance,
        "y": config.run.start_y,
        **timing,
    }
    machine_node = {
        "seed": config.run.seed,
        "required_subscribers": [_RECORDER],
        "state_rate": 1.0 / (command_interval_ticks * tick_period),
        "stepping": {
            field.name: getattr(config.stepping, field.name)
            for field in node_fields(MachineSimParams)
        },
        "particles": asdict(config.particles),
    }
    operator = {
        "machine": str(config.machine_file),
        "behaviour": asdict(config.behaviour),
        "task": asdict(config.task),
    }
    recorder = {"path": str(bag.resolve()), "progress": False}
    nodes = {"/soil_sim": soil, f"/{_RECORDER}": recorder}
    if config.truck_machine is None:
        nodes[f"{EXCAVATOR_NAMESPACE}/machine_sim"] = {**excavator, **machine_node}
        nodes[f"{EXCAVATOR_NAMESPACE}/dig_operator"] = operator
    else:
        nodes |= _nodes_with_truck(config, excavator, timing, machine_node, operator)
    content: dict[str, Any] = {name: {"ros__parameters": values} for name, values in nodes.items()}
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")


def _nodes_with_truck(
    config: RunConfig,
    excavator: dict[str, Any],
    timing: dict[str, Any],
    machine_node: dict[str, Any],
    operator: dict[str, Any],
) -> dict[str, dict[str, Any]]:
    """Return the parameters of machine node and operators of an excavator that loads a truck.

    Args:
        config: parameters of the run.
        excavator: parameters of the excavator.
        timing: parameters of each machine that time its commands.
        machine_node: parameters of the machine node.
        operator: parameters of the excavator's operator.
    """
    truck_namespace = config.task.truck
    truck_name = truck_namespace.rpartition("/")[2]
    digger_name = DIGGER_NAMESPACE.rpartition("/")[2]
    truck = {
        "machine": str(config.truck_file),
        "x": config.truck.x,
        "y": config.truck.y,
        "yaw": config.truck.yaw,
        **timing,
    }
    simulation = {"simulation_namespace": "/"}
    haul = {
        **simulation,
        "machine": str(config.truck_file),
        "other_machines": [DIGGER_NAMESPACE],
        # An empty list has no type in a parameter file.
        "haul": {name: value for name, value in asdict(config.haul).items() if value != ()},
    }
    return {
        f"{SITE_NAMESPACE}/machine_sim": {
            "machines": [digger_name, truck_name],
            digger_name: excavator,
            truck_name: truck,
            **machine_node,
        },
        # The run ends with the last load of the truck; until then the machine needs commands.
        f"{DIGGER_NAMESPACE}/dig_operator": {
            **operator,
            **simulation,
            "other_machines": [truck_namespace],
            "keep_running": True,
        },
        f"{truck_namespace}/dig_operator": haul,
    }
