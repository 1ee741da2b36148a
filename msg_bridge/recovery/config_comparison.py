"""Compare the configuration of a run with that of a restarted node."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

from msg_bridge.yaml_text import load_yaml

__all__ = ["find_config_difference"]


def find_config_difference(before: str, now: str, *, ignored: Collection[str] = ()) -> str:
    """Return the first value in which two configurations differ; empty if they are equal.

    Args:
        before: configuration of the run [YAML].
        now: that of the node.
        ignored: names of values that may differ, such as `soil_sim.map_rate`.
    """
    values_before = dict(_flatten(load_yaml(before)))
    values_now = dict(_flatten(load_yaml(now)))
    for name in sorted(values_before.keys() | values_now.keys()):
        if name in ignored:
            continue
        value, value_now = values_before.get(name), values_now.get(name)
        if value != value_now:
            return f"{name} was {value!r} and is {value_now!r}"
    return ""


def _flatten(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Yield each value of nested mappings and lists with its name."""
    if isinstance(value, dict):
        for key, each in value.items():
            yield from _flatten(each, f"{name}.{key}" if name else str(key))
    elif isinstance(value, list):
        for k, each in enumerate(value):
            yield from _flatten(each, f"{name}[{k}]")
    else:
        yield name, value
