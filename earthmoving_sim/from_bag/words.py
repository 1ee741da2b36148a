"""What small messages of a recorded run say: which are read, and what is kept of each."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import fields
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from machine_sim.machine import EXCAVATOR_JOINTS
from machine_sim.operator import CycleReport
from msg_bridge.codec.headers import from_multi_array
from msg_bridge.codec.machine_state import BaseState
from msg_bridge.codec.poses import from_odometry
from msg_bridge.codec.sim_config import RunFacts, run_facts
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import SoilHeader
from msg_bridge.nodes.topics import TICK_TOPIC

__all__ = [
    "CONFIG",
    "CYCLES",
    "DIAGNOSTICS",
    "HASH",
    "JOINTS",
    "LEDGER",
    "MACHINE_CONFIG",
    "ODOM",
    "PARTICLES",
    "PHASE",
    "PHASE_NAMES",
    "BagOutcomeError",
    "Place",
    "Word",
    "machine_section",
    "words_of_run",
]

CONFIG = "/sim/config"
LEDGER = "/soil/ledger"
HASH = "/soil/state_hash"
DIAGNOSTICS = "/diagnostics"
PHASE = "/operator/phase"  # below the machine's namespace, as all that follow
CYCLES = "/operator/cycles"
ODOM = "/odom"
JOINTS = "/joint_states"
PARTICLES = "/particles"  # below that of the machine's node, as the next
MACHINE_CONFIG = "/config"

PHASE_NAMES = ("cycle", "phase", "given_up")
"""What a message on the operator's phase tells beside its time."""

_CYCLE_NAMES = tuple(field.name for field in fields(CycleReport))


class BagOutcomeError(EarthmovingError):
    """A bag does not tell what a run did."""


class Word(NamedTuple):
    """Type of a topic's messages, and what is kept of one: None for nothing."""

    type: str
    take: Callable[[Any], Any]


class Place(NamedTuple):
    """Namespaces of a machine and of the node that simulates it, alone or with others."""

    machine: str
    node: str


def words_of_run(place: Place) -> dict[str, Word]:
    """The topics that are read, of a machine at some place."""
    return {
        **_OF_ALL,
        **{place.machine + name: word for name, word in _OF_MACHINE.items()},
        **{place.node + name: word for name, word in _OF_NODE.items()},
    }


def machine_section(text: str, place: Place) -> Any:
    """What the configuration of a node [YAML] says of one machine.

    Raises:
        KeyError, TypeError, YAMLError: it says nothing of it.
    """
    config = yaml.safe_load(text)
    if place.machine == place.node:
        return config["machine_sim"]
    return config["machines"][place.machine.removeprefix(f"{place.node}/")]


def _header(msg: Any) -> SoilHeader | None:
    header = from_multi_array(msg)
    return header if isinstance(header, SoilHeader) else None


def _ledger(msg: Any) -> Ledger | None:
    ledger = from_multi_array(msg)
    return ledger if isinstance(ledger, Ledger) else None


def _facts(msg: Any) -> RunFacts:
    return run_facts(msg.data)


def _hash(msg: Any) -> tuple[int, str]:
    tick, _, digest = msg.data.partition(" ")
    if not tick.isdigit() or not digest:
        raise BagOutcomeError(f"{msg.data!r} is no tick and hash")
    return int(tick), digest


def _diagnostics(msg: Any) -> dict[str, dict[str, str]]:
    """Values of each node."""
    return {
        status.name.partition(":")[0]: {each.key: each.value for each in status.values}
        for status in msg.status
    }


def _odom(msg: Any) -> tuple[Any, BaseState]:
    return msg.header.stamp, from_odometry(msg)


def _joints(msg: Any) -> tuple[Any, NDArray[np.float64]]:
    angles = dict(zip(msg.name, msg.position, strict=False))
    missing = [name for name in EXCAVATOR_JOINTS if name not in angles]
    if missing:
        raise BagOutcomeError(f"it has no angle of {', '.join(missing)}")
    return msg.header.stamp, np.array([angles[name] for name in EXCAVATOR_JOINTS])


def _particles(msg: Any) -> tuple[Any, int]:
    return msg.header.stamp, msg.width


def _text(msg: Any) -> str:
    return str(msg.data)


def _phase(msg: Any) -> dict[str, Any]:
    return _object(msg.data, ("time", *PHASE_NAMES))


def _cycle(msg: Any) -> CycleReport:
    return CycleReport(**_object(msg.data, _CYCLE_NAMES))


def _object(text: str, names: tuple[str, ...]) -> dict[str, Any]:
    """A JSON object of certain names."""
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise BagOutcomeError(f"it must be JSON: {error}") from None
    if not isinstance(found, dict) or set(found) != set(names):
        raise BagOutcomeError(f"it must be an object of {', '.join(names)}; it is {text!r}")
    return found


_OF_ALL: dict[str, Word] = {
    CONFIG: Word("std_msgs/msg/String", _facts),
    TICK_TOPIC: Word("std_msgs/msg/Int64MultiArray", _header),
    LEDGER: Word("std_msgs/msg/Int64MultiArray", _ledger),
    HASH: Word("std_msgs/msg/String", _hash),
    DIAGNOSTICS: Word("diagnostic_msgs/msg/DiagnosticArray", _diagnostics),
}
_OF_MACHINE: dict[str, Word] = {
    PHASE: Word("std_msgs/msg/String", _phase),
    CYCLES: Word("std_msgs/msg/String", _cycle),
    ODOM: Word("nav_msgs/msg/Odometry", _odom),
    JOINTS: Word("sensor_msgs/msg/JointState", _joints),
}
_OF_NODE: dict[str, Word] = {
    MACHINE_CONFIG: Word("std_msgs/msg/String", _text),
    PARTICLES: Word("sensor_msgs/msg/PointCloud2", _particles),
}
