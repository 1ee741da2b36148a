"""Decoders of the small messages that a recorded run is derived from."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dig_operator import CycleReport, LoadReport
from machine_sim.machine import EXCAVATOR_JOINTS
from msg_bridge.codec.machine_state import BaseState
from msg_bridge.codec.poses import from_odometry
from msg_bridge.codec.run_config import RunFacts, parse_run_facts
from msg_bridge.codec.state_hash import from_state_hash_string
from msg_bridge.codec.tick_headers import from_multi_array
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import SoilHeader
from msg_bridge.yaml_text import load_yaml

__all__ = [
    "CYCLES_SUFFIX",
    "DIAGNOSTICS_TOPIC",
    "JOINT_STATES_SUFFIX",
    "LEDGER_TOPIC",
    "MACHINE_CONFIG_SUFFIX",
    "MAP_UPDATES_TOPIC",
    "ODOM_SUFFIX",
    "PARTICLES_SUFFIX",
    "PHASE_FIELDS",
    "PHASE_SUFFIX",
    "SIM_CONFIG_TOPIC",
    "SOIL_HEADER_TOPIC",
    "STATE_HASH_TOPIC",
    "TERRAIN_MAP_TOPIC",
    "Namespaces",
    "RecordedRunError",
    "TopicDecoder",
    "machine_config_section",
    "run_topic_decoders",
]

SIM_CONFIG_TOPIC = "/sim/config"
SOIL_HEADER_TOPIC = "/soil/tick"
TERRAIN_MAP_TOPIC = "/terrain/map"
MAP_UPDATES_TOPIC = "/terrain/map_updates"
LEDGER_TOPIC = "/soil/ledger"
STATE_HASH_TOPIC = "/soil/state_hash"
DIAGNOSTICS_TOPIC = "/diagnostics"
# In the machine's namespace:
PHASE_SUFFIX = "/operator/phase"
CYCLES_SUFFIX = "/operator/cycles"
ODOM_SUFFIX = "/odom"
JOINT_STATES_SUFFIX = "/joint_states"
# In the namespace of the machine node:
PARTICLES_SUFFIX = "/particles"
MACHINE_CONFIG_SUFFIX = "/config"

PHASE_FIELDS = ("cycle", "phase", "abort_reason")
"""Keys of a message on the operator's phase, besides its time."""

_CYCLE_FIELDS = tuple(field.name for field in fields(CycleReport))
_LOAD_FIELDS = tuple(field.name for field in fields(LoadReport))


class RecordedRunError(EarthmovingError):
    """A bag does not contain what is needed to derive what a run did."""


class TopicDecoder(NamedTuple):
    """Type of a topic's messages, and the function that returns what is kept of one.

    The function returns None for a message of which nothing is kept.
    """

    type: str
    decode: Callable[[Any], Any]


class Namespaces(NamedTuple):
    """Namespaces of a machine, of the node that simulates it, and of a truck that it loads.

    All are relative to the namespace of the simulation, as all topics of a `BagReader` are. The
    truck's is empty without one; it is in the same node.
    """

    machine: str
    node: str
    truck: str = ""


def run_topic_decoders(namespaces: Namespaces) -> dict[str, TopicDecoder]:
    """Return the decoder of each topic that is read."""
    return {
        **_GLOBAL_DECODERS,
        **{namespaces.machine + name: decoder for name, decoder in _MACHINE_DECODERS.items()},
        **{namespaces.node + name: decoder for name, decoder in _NODE_DECODERS.items()},
        **(
            {namespaces.truck + name: decoder for name, decoder in _TRUCK_DECODERS.items()}
            if namespaces.truck
            else {}
        ),
    }


def machine_config_section(text: str, namespaces: Namespaces) -> Any:
    """Return the parameters of one machine from the configuration of its node.

    Args:
        text: the configuration [YAML].
        namespaces: those of the machine.

    Raises:
        KeyError, TypeError, YAMLError: it has no such section.
    """
    config = load_yaml(text)
    if namespaces.machine == namespaces.node:
        return config["machine_sim"]
    return config["machines"][namespaces.machine.removeprefix(f"{namespaces.node}/")]


def _decode_soil_header(msg: Any) -> SoilHeader | None:
    header = from_multi_array(msg)
    return header if isinstance(header, SoilHeader) else None


def _decode_ledger(msg: Any) -> Ledger | None:
    ledger = from_multi_array(msg)
    return ledger if isinstance(ledger, Ledger) else None


def _decode_run_facts(msg: Any) -> RunFacts:
    return parse_run_facts(msg.data)


def _decode_diagnostics(msg: Any) -> dict[str, dict[str, str]]:
    """Return the values of each node by key."""
    return {
        status.name.partition(":")[0]: {each.key: each.value for each in status.values}
        for status in msg.status
    }


def _decode_odometry(msg: Any) -> tuple[Any, BaseState]:
    return msg.header.stamp, from_odometry(msg)


def _decode_joint_angles(msg: Any) -> tuple[Any, NDArray[np.float64]]:
    """Return the stamp and the joint angles [rad], shape (4,), in the order of EXCAVATOR_JOINTS."""
    angles = dict(zip(msg.name, msg.position, strict=False))
    missing = [name for name in EXCAVATOR_JOINTS if name not in angles]
    if missing:
        raise RecordedRunError(f"it has no angle of {', '.join(missing)}")
    return msg.header.stamp, np.array([angles[name] for name in EXCAVATOR_JOINTS])


def _decode_joints_by_name(msg: Any) -> tuple[Any, dict[str, float]]:
    return msg.header.stamp, dict(zip(msg.name, msg.position, strict=False))


def _decode_particle_count(msg: Any) -> tuple[Any, int]:
    return msg.header.stamp, msg.width


def _decode_text(msg: Any) -> str:
    return str(msg.data)


def _decode_phase(msg: Any) -> dict[str, Any]:
    return _parse_object(msg.data, ("time", *PHASE_FIELDS))


def _decode_cycle_report(msg: Any) -> CycleReport:
    return CycleReport(**_parse_object(msg.data, _CYCLE_FIELDS))


def _decode_load_report(msg: Any) -> LoadReport:
    return LoadReport(**_parse_object(msg.data, _LOAD_FIELDS))


def _parse_object(text: str, names: tuple[str, ...]) -> dict[str, Any]:
    """Parse a JSON object that must have exactly the given keys."""
    try:
        parsed = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise RecordedRunError(f"it must be JSON: {error}") from None
    if not isinstance(parsed, dict) or set(parsed) != set(names):
        raise RecordedRunError(f"it must be an object of {', '.join(names)}; it is {text!r}")
    return parsed


_GLOBAL_DECODERS: dict[str, TopicDecoder] = {
    SIM_CONFIG_TOPIC: TopicDecoder("std_msgs/msg/String", _decode_run_facts),
    SOIL_HEADER_TOPIC: TopicDecoder("std_msgs/msg/Int64MultiArray", _decode_soil_header),
    LEDGER_TOPIC: TopicDecoder("std_msgs/msg/Int64MultiArray", _decode_ledger),
    STATE_HASH_TOPIC: TopicDecoder("std_msgs/msg/String", from_state_hash_string),
    DIAGNOSTICS_TOPIC: TopicDecoder("diagnostic_msgs/msg/DiagnosticArray", _decode_diagnostics),
}
_MACHINE_DECODERS: dict[str, TopicDecoder] = {
    PHASE_SUFFIX: TopicDecoder("std_msgs/msg/String", _decode_phase),
    CYCLES_SUFFIX: TopicDecoder("std_msgs/msg/String", _decode_cycle_report),
    ODOM_SUFFIX: TopicDecoder("nav_msgs/msg/Odometry", _decode_odometry),
    JOINT_STATES_SUFFIX: TopicDecoder("sensor_msgs/msg/JointState", _decode_joint_angles),
}
_TRUCK_DECODERS: dict[str, TopicDecoder] = {
    PHASE_SUFFIX: TopicDecoder("std_msgs/msg/String", _decode_phase),
    CYCLES_SUFFIX: TopicDecoder("std_msgs/msg/String", _decode_load_report),
    ODOM_SUFFIX: TopicDecoder("nav_msgs/msg/Odometry", _decode_odometry),
    JOINT_STATES_SUFFIX: TopicDecoder("sensor_msgs/msg/JointState", _decode_joints_by_name),
}
_NODE_DECODERS: dict[str, TopicDecoder] = {
    MACHINE_CONFIG_SUFFIX: TopicDecoder("std_msgs/msg/String", _decode_text),
    PARTICLES_SUFFIX: TopicDecoder("sensor_msgs/msg/PointCloud2", _decode_particle_count),
}
