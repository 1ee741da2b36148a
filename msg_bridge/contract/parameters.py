"""Parameters as frozen dataclasses with unit, range and description, validated when built.

The same dataclass is read from YAML and declared to ROS by a node, so that each fact about a
parameter is stated once.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, TypeVar

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.suggestions import suggestion

__all__ = ["Parameters", "check_value", "item_type", "node_fields", "parameter"]

P = TypeVar("P", bound="Parameters")


def parameter(
    default: Any,
    doc: str,
    *,
    unit: str = "",
    low: float = -math.inf,
    high: float = math.inf,
    choices: tuple[str, ...] = (),
    items: type | None = None,
    determined_by: str = "",
) -> Any:
    """Return a dataclass field with the documentation and range of a parameter.

    Args:
        default: default value; a tuple makes the parameter a list of numbers or strings.
        doc: description, one sentence.
        unit: SI unit, empty for a dimensionless number.
        low, high: inclusive range of a number, or of each number of a list.
        choices: the allowed values of a string, or of each string of a list.
        items: type of the elements of a list; required only if the default is the empty tuple.
        determined_by: what determines the value in a node, where it is no parameter; empty: it is a
            parameter of nodes, too.
    """
    if default == () and items is None:
        raise TypeError("an empty default has no element type; give `items` too")
    metadata = {
        "doc": doc,
        "unit": unit,
        "low": low,
        "high": high,
        "choices": choices,
        "determined_by": determined_by,
    }
    if isinstance(default, tuple):
        metadata["items"] = items or type(default[0])
    return dataclasses.field(default=default, metadata=metadata)


@dataclass(frozen=True)
class Parameters:
    """Base class of parameter sets: each field made by `parameter` is validated when built.

    A whole number for a parameter that is a float becomes one: kernels are compiled for floats.
    """

    def __post_init__(self) -> None:
        for field in fields(self):
            if field.metadata:
                value = getattr(self, field.name)
                check_value(f"{type(self).__name__}.{field.name}", field, value)
                if isinstance(value, list):
                    object.__setattr__(self, field.name, tuple(value))
                elif isinstance(field.default, float):
                    object.__setattr__(self, field.name, float(value))

    @classmethod
    def from_mapping(cls: type[P], values: Mapping[str, Any], *, prefix: str | None = None) -> P:
        """Build from a mapping (a YAML section, or command-line options).

        Args:
            values: values by name; the others have their defaults.
            prefix: what stands before the names where the user has written them: `soil.` in a
                configuration, `--` on a command line. Errors name parameters in this way, by
                default with the name of the class.

        Raises:
            ParameterError: an unknown name, a wrong type, or a value outside its range.
        """
        known = {field.name: field for field in fields(cls)}
        unknown = sorted(set(values) - set(known))
        if unknown:
            names = ", ".join(f"{name}{suggestion(name, known)}" for name in unknown)
            raise ParameterError(
                f"{cls.__name__} has no parameter {names}; it has {', '.join(known)}"
            )
        if prefix is not None:
            for name, value in values.items():
                if known[name].metadata:
                    check_value(f"{prefix}{name}", known[name], value)
        return cls(**dict(values))


def node_fields(params_class: type[Parameters]) -> list[dataclasses.Field[Any]]:
    """Return the fields that are parameters of a node, in their order."""
    return [field for field in fields(params_class) if not field.metadata.get("determined_by")]


def item_type(field: dataclasses.Field[Any]) -> type | None:
    """Return the element type of a list parameter; None if the parameter is not a list."""
    return field.metadata.get("items")


def check_value(name: str, field: dataclasses.Field[Any], value: Any) -> None:
    """Validate a value for a field made by `parameter`.

    Args:
        name: name of the parameter in error messages.
        field: the field.
        value: value to validate.

    Raises:
        ParameterError: a wrong type, or a value outside its range.
    """
    items = item_type(field)
    if items is None:
        _check(name, type(field.default), field.metadata, value)
    elif not isinstance(value, (list, tuple)):
        raise ParameterError(f"{name} is {value!r}; give a list ({field.metadata['doc']})")
    else:
        for index, item in enumerate(value):
            _check(f"{name}[{index}]", items, field.metadata, item)


def _check(name: str, kind: type, meta: Mapping[str, Any], value: Any) -> None:
    if kind is bool:
        if not isinstance(value, bool):
            raise ParameterError(f"{name} is {value!r}; give true or false ({meta['doc']})")
    elif kind is str:
        if not isinstance(value, str) or (meta["choices"] and value not in meta["choices"]):
            allowed = ", ".join(meta["choices"]) or "a text"
            raise ParameterError(f"{name} is {value!r}; give one of: {allowed} ({meta['doc']})")
    elif kind in (int, float):
        is_number = isinstance(value, int if kind is int else (int, float))
        if isinstance(value, bool) or not is_number or not math.isfinite(value):
            wanted = "a whole number" if kind is int else "a finite number"
            raise ParameterError(f"{name} is {value!r}; give {wanted} ({meta['doc']})")
        if not meta["low"] <= value <= meta["high"]:
            unit = f" {meta['unit']}" if meta["unit"] else ""
            raise ParameterError(
                f"{name} is {value}{unit}; give a value from {meta['low']} to {meta['high']}{unit}"
                f" ({meta['doc']})"
            )
