"""Upgrade messages of format 1 to the names of format 2, the current one.

A bag of format 1 has no `format_version` in its metadata.yaml; its messages are recognised by their
names. Point fields, array labels, JSON keys, YAML keys and diagnostics keys are renamed to the
current ones (`legacy_names`) and values without a successor are dropped, so that code which reads
bags uses current names only. Numbers and units are the same in both formats, with these exceptions:
the moisture of terrain maps is a fraction of saturation in format 1 and per cent in format 2, and
`map_period` and `hash_period` [s] in configurations became rates [Hz].

Ledgers and state hashes of format 1 do not state their run. They get the number of the run that was
recorded at that time, and the end time of their tick.

Rows of either format may lack fields of the current ones (`ADDED_FIELDS`), which get a value that
stands for the absence.

Each upgrade checks for an old name first and leaves current messages as they are.
"""

from __future__ import annotations

import array
import copy
import json
import re
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from msg_bridge.bag.legacy_names import (
    ADDED_FIELDS,
    CONFIG_KEYS,
    DIAGNOSTICS_KEYS,
    DROPPED_LABELS,
    FIELDS,
    JSON_KEYS,
    MACHINE_KEYS,
    NODES,
    RANGES,
    SOIL_KEYS,
    TRACK_MODELS,
)
from msg_bridge.yaml_text import load_yaml

__all__ = ["RecordedRun", "upgrade_message"]

_STATE_HASH = re.compile(r"(\d+) ([0-9a-f]{64})")

_UINT32, _FLOAT32 = 6, 7
"""Datatypes of PointField; this module does not import ROS messages."""

_LEDGER_TOPIC = "/soil/ledger"
_NANO = 10**9


class RecordedRun(NamedTuple):
    """A run in a bag: its number and tick period [s]."""

    run_id: int
    tick_period: float


def upgrade_message(
    topic: str, message: Any, run: Callable[[], RecordedRun | None] = lambda: None
) -> Any:
    """Rename in a message of a bag what format 1 named otherwise.

    Args:
        topic: the current name of its topic.
        message: the decoded message; it is changed in place.
        run: returns the run at the message's log time; called only if the message needs it.

    Returns:
        The message.
    """
    upgrade = _UPGRADES.get(type(message).__name__)
    if upgrade is not None:
        upgrade(topic, message)
    if topic == _LEDGER_TOPIC:
        _upgrade_ledger(message, run)
    elif topic.endswith("/state_hash"):
        _upgrade_state_hash(message, run)
    return message


def _upgrade_cloud(topic: str, message: Any) -> None:
    """Rename the fields of rows and terrain maps; both end with the number of the run.

    The moisture of terrain maps, float32, is converted from a fraction to per cent.
    """
    if any(field.name == "epoch" for field in message.fields):
        message.fields = [copy.copy(field) for field in message.fields]  # others may have them, too
        for field in message.fields:
            field.name = FIELDS.get(field.name, field.name)
            if field.name == "moisture" and field.datatype == _FLOAT32:
                _scale_to_percent(message, field.offset)
    for name, dtype, before, value in ADDED_FIELDS.get(topic.rpartition("/")[2], ()):
        if all(field.name != name for field in message.fields):
            _insert_field(message, name, np.array(value, dtype), before)


def _insert_field(cloud: Any, name: str, value: NDArray[Any], before: str) -> None:
    """Insert a field of 4 bytes with a value before another field of every point."""
    at = next((k for k, field in enumerate(cloud.fields) if field.name == before), None)
    step = int(cloud.point_step)
    data = np.array(cloud.data, dtype=np.uint8)
    if at is None or step == 0 or data.size % step:
        return  # the decoder of the message reports the error
    # Copies: other messages may have the same fields.
    fields = [copy.copy(field) for field in cloud.fields]
    offset = int(fields[at].offset)
    field = copy.copy(fields[at])
    field.name, field.datatype = name, _FLOAT32 if value.dtype.kind == "f" else _UINT32
    for following in fields[at:]:
        following.offset += value.itemsize
    cloud.fields = [*fields[:at], field, *fields[at:]]
    added = np.frombuffer(value.tobytes(), np.uint8)
    points = np.insert(data.reshape(-1, step), [offset] * added.size, added, axis=1)
    cloud.data = array.array("B", points.tobytes())
    cloud.point_step += value.itemsize
    cloud.row_step = cloud.width * cloud.point_step


def _scale_to_percent(cloud: Any, offset: int) -> None:
    """Convert a float32 field of every point from a fraction to whole per cents."""
    step = int(cloud.point_step)
    data = np.array(cloud.data, dtype=np.uint8)
    if offset + 4 > step or data.size == 0 or data.size % step:
        return  # the decoder of the message reports the error
    values = np.ndarray(data.size // step, "<f4", data, offset, strides=(step,))
    with np.errstate(over="ignore"):
        values[:] = np.rint(100.0 * values)
    cloud.data = array.array("B", data.tobytes())


def _upgrade_array(topic: str, message: Any) -> None:
    """Rename the values of a header or request, and drop those without a successor."""
    if len(message.layout.dim) != 1:
        return
    (dimension,) = message.layout.dim
    names = dimension.label.split(",")
    if "epoch" not in names or len(names) != len(message.data):
        return
    renamed = [_current_label(name) for name in names]
    kept = [k for k, name in enumerate(renamed) if name.rpartition(".")[2] not in DROPPED_LABELS]
    message.data = array.array("q", [message.data[k] for k in kept])
    dimension.label = ",".join(renamed[k] for k in kept)
    dimension.size = dimension.stride = len(kept)


def _upgrade_ledger(message: Any, run: Callable[[], RecordedRun | None]) -> None:
    """Insert the number of the run and the stamp into a ledger that has neither."""
    if len(message.layout.dim) != 1:
        return
    (dimension,) = message.layout.dim
    names = dimension.label.split(",")
    if names[:2] != ["kind", "tick"] or names[-1] != "imbalance":
        return
    if len(names) != len(message.data) or (found := run()) is None:
        return
    kind, tick, *accounts, imbalance = message.data
    values = [kind, found.run_id, tick, *accounts, *_end_of_tick(tick, found), imbalance]
    message.data = array.array("q", values)
    names = ["kind", "run_id", *names[1:-1], "stamp_sec", "stamp_nanosec", "imbalance"]
    dimension.label = ",".join(names)
    dimension.size = dimension.stride = len(names)


def _upgrade_state_hash(message: Any, run: Callable[[], RecordedRun | None]) -> None:
    """Replace `tick digest` by a JSON object."""
    match = _STATE_HASH.fullmatch(message.data)
    if match is None or (found := run()) is None:
        return
    tick = int(match[1])
    sec, nanosec = _end_of_tick(tick, found)
    stamp = {"sec": sec, "nanosec": nanosec}
    values = {"run_id": found.run_id, "tick": tick, "stamp": stamp, "sha256": match[2]}
    message.data = json.dumps(values)


def _end_of_tick(tick: int, run: RecordedRun) -> tuple[int, int]:
    """Return the simulation time at the end of a tick: seconds, nanoseconds."""
    period = Fraction(repr(run.tick_period)) * _NANO
    return divmod(round(tick * period), _NANO)


def _current_label(name: str) -> str:
    parts = name.split(".")
    parts[-1] = FIELDS.get(parts[-1], parts[-1])
    if len(parts) > 1:
        parts[0] = RANGES.get(parts[0], parts[0])
    return ".".join(parts)


def _upgrade_text(topic: str, message: Any) -> None:
    """Rename the keys of a YAML configuration or of a JSON object."""
    name = topic.rpartition("/")[2]
    if name == "config":
        message.data = _upgrade_config(message.data)
    elif name in JSON_KEYS:
        message.data = _upgrade_object(message.data, JSON_KEYS[name])


def _upgrade_object(text: str, keys: Mapping[str, str]) -> str:
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        return text  # the decoder reports the error
    if not isinstance(found, dict) or not found.keys() & keys.keys():
        return text
    return json.dumps(_rename(found, keys))


def _periods_to_rates(section: dict[str, Any]) -> bool:
    """Replace periods [s] of the soil node by rates [Hz]; return whether there were any."""
    found = [name for name in ("map_period", "hash_period") if name in section]
    for name in found:
        section[name.replace("period", "rate")] = 1.0 / section.pop(name)
    return bool(found)


def _upgrade_config(text: str) -> str:
    try:
        config = load_yaml(text)
        has_periods = _periods_to_rates(config.get("soil_sim", {}))
        if "epoch" not in config["run"]:
            return str(yaml.safe_dump(config, sort_keys=False)) if has_periods else text
        for section, keys in CONFIG_KEYS.items():
            if section in config:
                config[section] = _rename(config[section], keys)
        machines = config.get("machines", {})
        config["run"]["soils"] = [_rename(soil, SOIL_KEYS) for soil in config["run"]["soils"]]
        for machine, values in machines.items():
            machines[machine] = _rename(values, MACHINE_KEYS)
        for section in ("soil_sim", "machine_sim"):
            nodes = config.get(section, {}).get("required_subscribers")
            if nodes is not None:
                config[section]["required_subscribers"] = [NODES.get(n, n) for n in nodes]
        if config.get("soil", {}).get("force_mode") == "reference":
            config["soil"]["force_mode"] = "none"
        if "track_model" in config.get("stepping", {}):
            model = config["stepping"]["track_model"]
            config["stepping"]["track_model"] = TRACK_MODELS.get(model, model)
    except (yaml.YAMLError, KeyError, TypeError, AttributeError):
        return text  # the decoder reports the error
    return str(yaml.safe_dump(config, sort_keys=False))


def _upgrade_diagnostics(topic: str, message: Any) -> None:
    """Rename nodes and keys."""
    for status in message.status:
        path, separator, component = status.name.partition(": ")
        namespace, slash, node = path.rpartition("/")
        node = NODES.get(node, node)
        status.name = f"{namespace}{slash}{node}{separator}{NODES.get(component, component)}"
        keys = DIAGNOSTICS_KEYS.get(node, {})
        for entry in status.values:
            entry.key = keys.get(entry.key, entry.key)


def _rename(values: Mapping[str, Any], keys: Mapping[str, str]) -> dict[str, Any]:
    """Return a copy with renamed keys in the same order."""
    return {keys.get(key, key): value for key, value in values.items()}


_UPGRADES: dict[str, Callable[[str, Any], None]] = {
    "PointCloud2": _upgrade_cloud,
    "Int64MultiArray": _upgrade_array,
    "String": _upgrade_text,
    "DiagnosticArray": _upgrade_diagnostics,
}
