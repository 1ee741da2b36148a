"""Parameters as frozen dataclasses that carry their unit, range and meaning, checked when built.

The same dataclass is read from YAML here and declared to ROS by a node, so that nothing about a
parameter is written twice.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, TypeVar

from msg_bridge.contract.errors import ParameterError

__all__ = ["Parameters", "parameter"]

P = TypeVar("P", bound="Parameters")


def parameter(
    default: Any,
    doc: str,
    *,
    unit: str = "",
    low: float = -math.inf,
    high: float = math.inf,
    choices: tuple[str, ...] = (),
) -> Any:
    """A dataclass field with what a user must know about it.

    Args:
        default: the value when none is given.
        doc: one sentence on what it means.
        unit: SI unit, empty for a pure number.
        low, high: inclusive range of a number.
        choices: the allowed values of a string.
    """
    metadata = {"doc": doc, "unit": unit, "low": low, "high": high, "choices": choices}
    return dataclasses.field(default=default, metadata=metadata)


@dataclass(frozen=True)
class Parameters:
    """Base of parameter sets: every field made by `parameter` is checked when the set is built."""

    def __post_init__(self) -> None:
        for field in fields(self):
            if field.metadata:
                _check(type(self).__name__, field, getattr(self, field.name))

    @classmethod
    def from_mapping(cls: type[P], values: Mapping[str, Any]) -> P:
        """Build from a mapping (a YAML section).

        Raises:
            ParameterError: an unknown name, a wrong type, or a value outside its range.
        """
        known = [field.name for field in fields(cls)]
        unknown = sorted(set(values) - set(known))
        if unknown:
            raise ParameterError(
                f"{cls.__name__} has no parameter {', '.join(unknown)}; it has {', '.join(known)}"
            )
        return cls(**dict(values))


def _check(owner: str, field: dataclasses.Field[Any], value: Any) -> None:
    meta = field.metadata
    name = f"{owner}.{field.name}"
    if isinstance(field.default, bool):
        if not isinstance(value, bool):
            raise ParameterError(f"{name} is {value!r}; give true or false ({meta['doc']})")
    elif isinstance(field.default, str):
        if not isinstance(value, str) or (meta["choices"] and value not in meta["choices"]):
            allowed = ", ".join(meta["choices"]) or "a text"
            raise ParameterError(f"{name} is {value!r}; give one of: {allowed} ({meta['doc']})")
    elif isinstance(field.default, (int, float)):
        whole = isinstance(field.default, int)
        right_type = isinstance(value, int if whole else (int, float))
        if isinstance(value, bool) or not right_type or not math.isfinite(value):
            kind = "a whole number" if whole else "a finite number"
            raise ParameterError(f"{name} is {value!r}; give {kind} ({meta['doc']})")
        if not meta["low"] <= value <= meta["high"]:
            unit = f" {meta['unit']}" if meta["unit"] else ""
            raise ParameterError(
                f"{name} is {value}{unit}; give a value from {meta['low']} to {meta['high']}{unit}"
                f" ({meta['doc']})"
            )
