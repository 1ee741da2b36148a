"""A message type as Arrow columns: nested messages become columns with dots in their names."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from operator import attrgetter
from typing import Any, NamedTuple

import pyarrow as pa

from earthmoving_sim.bag_export.message_types import Field, MessageTypes
from earthmoving_sim.bag_export.units import unit_of

__all__ = ["LOG_TIME", "Column", "arrow_field", "columns_of", "struct_of", "with_free_names"]

_NANO = 10**9
_STAMP, _DURATION = "builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"

_PRIMITIVES = {
    "bool": pa.bool_(),
    "byte": pa.uint8(),
    "octet": pa.uint8(),
    "char": pa.uint8(),
    "float32": pa.float32(),
    "float64": pa.float64(),
    "string": pa.string(),
    "wstring": pa.string(),
    **{
        f"{sign}int{bits}": getattr(pa, f"{sign}int{bits}")()
        for sign in ("", "u")
        for bits in (8, 16, 32, 64)
    },
}


class Column(NamedTuple):
    """A column.

    Attributes:
        field: name, Arrow type and metadata.
        value: returns the value of a message, as pyarrow takes it.
    """

    field: pa.Field
    value: Callable[[Any], Any]


def arrow_field(name: str, kind: pa.DataType, unit: str = "") -> pa.Field:
    """Return a field with its unit as metadata, if it has one."""
    return pa.field(name, kind, metadata={"unit": unit} if unit else None)


LOG_TIME = arrow_field("log_time", pa.timestamp("ns", "UTC"))
"""First column of every table: time of reception, or simulation time with `use_sim_time`."""


def with_free_names(fields: Iterable[pa.Field], taken: Iterable[str]) -> list[pa.Field]:
    """Return fields of which none has the name of another column; `_` is appended to such names.

    Args:
        fields: the fields, whose own names differ.
        taken: names of the other columns.
    """
    names, found = set(taken), []
    for each in fields:
        name = each.name
        while name in names:
            name += "_"
        names.add(name)
        found.append(each.with_name(name))
    return found


def columns_of(types: MessageTypes, type_name: str) -> list[Column]:
    """Return the columns of a message type, at least one.

    Those of its header are `stamp` and `frame_id`, unless it has other fields of these names.

    Raises:
        UnreadableTypeError: the bag lacks a definition.
    """
    flat = _flatten(types, type_name, "", "")
    names = {each.path for each in flat}
    columns = []
    for each in flat:
        short = each.path.removeprefix("header.")
        name = each.path if short in names else short
        columns.append(Column(each.field.with_name(name), _attribute(each.path, each.convert)))
    return columns or [Column(arrow_field("empty", pa.bool_()), lambda message: None)]


def struct_of(types: MessageTypes, type_name: str) -> tuple[pa.DataType, Callable[[Any], Any]]:
    """Return a message type as an Arrow struct, and the function that converts a message to it."""
    flat = [
        (each.field, each.path, attrgetter(each.path), each.convert)
        for each in _flatten(types, type_name, "", "")
    ]

    def convert(message: Any) -> dict[str, Any]:
        return {
            field.name: value if to is None else to(value)
            for field, _, get, to in flat
            for value in (get(message),)
        }

    return pa.struct([field for field, *_ in flat]), convert


class _FlatField(NamedTuple):
    field: pa.Field
    path: str
    convert: Callable[[Any], Any] | None


def _flatten(types: MessageTypes, type_name: str, prefix: str, unit: str) -> list[_FlatField]:
    """Return the primitive fields and arrays of a message type.

    Args:
        types: all types.
        type_name: the message type.
        prefix: path of the message, with a dot at its end.
        unit: unit that it inherits.
    """
    flat: list[_FlatField] = []
    for each in types.fields(type_name):
        path = prefix + each.name
        own_unit = unit_of(each.name, type_name) or unit
        if each.is_message and each.length is None and each.type not in (_STAMP, _DURATION):
            flat += _flatten(types, each.type, f"{path}.", own_unit)
        else:
            kind, convert = _value_type(types, each)
            flat.append(_FlatField(arrow_field(path, kind, own_unit), path, convert))
    return flat


def _value_type(
    types: MessageTypes, field: Field
) -> tuple[pa.DataType, Callable[[Any], Any] | None]:
    """Return the Arrow type of a field, and the conversion of its values if one is needed."""
    item, convert = _item_type(types, field)
    if field.length is None:
        return item, convert
    if field.type in ("uint8", "byte", "octet", "char") and not field.is_message:
        return pa.binary(), bytes
    kind = pa.list_(item, field.length) if field.length else pa.list_(item)
    if convert is None:
        return kind, list
    return kind, lambda values: [convert(value) for value in values]


def _item_type(
    types: MessageTypes, field: Field
) -> tuple[pa.DataType, Callable[[Any], Any] | None]:
    if field.type == _STAMP:
        return pa.timestamp("ns"), _nanoseconds
    if field.type == _DURATION:
        return pa.duration("ns"), _nanoseconds
    if field.is_message:
        return struct_of(types, field.type)
    if field.type in ("byte", "octet"):
        return pa.uint8(), _byte
    return _PRIMITIVES[field.type], None


def _nanoseconds(value: Any) -> int:
    return int(value.sec) * _NANO + int(value.nanosec)


def _byte(value: Any) -> int:
    """Return the value of a byte, which rclpy has as bytes of length 1."""
    return value[0] if isinstance(value, bytes) else int(value)


def _attribute(path: str, convert: Callable[[Any], Any] | None) -> Callable[[Any], Any]:
    get = attrgetter(path)
    return get if convert is None else lambda message: convert(get(message))
