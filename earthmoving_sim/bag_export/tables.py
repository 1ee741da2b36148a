"""Messages as rows of tables: of any type, and of those with a table of their own."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Any, Protocol

import pyarrow as pa

from earthmoving_sim.bag_export.columns import Column, arrow_field, columns_of
from earthmoving_sim.bag_export.message_types import MessageTypes
from earthmoving_sim.bag_export.units import unit_of
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.labelled_array import array_label

__all__ = [
    "ArrayTable",
    "JointTable",
    "JsonTable",
    "MessageTable",
    "StatusTable",
    "Table",
]

_NANO = 10**9
_STAMP = arrow_field("stamp", pa.timestamp("ns"))
_MAX_EXACT = 2**53


class Table(Protocol):
    """Converts the messages of a topic to rows."""

    @property
    def fields(self) -> Sequence[pa.Field]:
        """Columns of the table, without the log time."""

    def rows(self, message: Any) -> Mapping[str, Any] | None:
        """Return the values of each column for one message; None if it has no place in the table.

        All values have the same length, one for each row.
        """


class MessageTable:
    """A row for each message; for each element, if its only field is an array of messages."""

    def __init__(self, types: MessageTypes, type_name: str) -> None:
        """
        Raises:
            UnreadableTypeError: the bag lacks a definition.
        """
        fields = types.fields(type_name)
        is_array = len(fields) == 1 and fields[0].is_message and fields[0].length is not None
        self._array = fields[0].name if is_array else ""
        self._columns: list[Column] = columns_of(types, fields[0].type if is_array else type_name)
        self.fields = [column.field for column in self._columns]

    def rows(self, message: Any) -> Mapping[str, Any]:
        """Return the values of a message."""
        items = getattr(message, self._array) if self._array else (message,)
        return {
            column.field.name: [column.value(item) for item in items] for column in self._columns
        }


class JointTable:
    """A row for each joint of a JointState."""

    fields = (
        _STAMP,
        arrow_field("joint", pa.string()),
        *(
            arrow_field(name, pa.float64(), unit_of(name, "sensor_msgs/msg/JointState"))
            for name in ("position", "velocity", "effort")
        ),
    )

    def rows(self, message: Any) -> Mapping[str, Any]:
        """Return the values of a message; arrays that are empty or too short give nulls."""
        count = len(message.name)
        values = {
            name: [*list(getattr(message, name))[:count]]
            for name in ("position", "velocity", "effort")
        }
        return {
            "stamp": count * [_nanoseconds(message.header.stamp)],
            "joint": list(message.name),
            **{name: found + (count - len(found)) * [None] for name, found in values.items()},
        }


class StatusTable:
    """A row for each value of a DiagnosticArray; a status without values has one row."""

    fields = (
        _STAMP,
        arrow_field("name", pa.string()),
        arrow_field("level", pa.uint8()),
        *(arrow_field(name, pa.string()) for name in ("message", "hardware_id", "key", "value")),
    )

    def rows(self, message: Any) -> Mapping[str, Any]:
        """Return the values of a message."""
        stamp = _nanoseconds(message.header.stamp)
        rows = [
            (stamp, each.name, _level(each.level), each.message, each.hardware_id, key, value)
            for each in message.status
            for key, value in [(pair.key, pair.value) for pair in each.values] or [(None, None)]
        ]
        columns = zip(*rows, strict=True) if rows else ((),) * len(self.fields)
        return {
            field.name: list(values) for field, values in zip(self.fields, columns, strict=True)
        }


class ArrayTable:
    """A column for each label of labelled arrays, Int64MultiArray or Float64MultiArray.

    Ledgers, headers and requests on one topic have different labels; what a message lacks is null.
    """

    def __init__(self, *, is_integer: bool) -> None:
        """
        Args:
            is_integer: whether the values are integers.
        """
        self._kind = pa.int64() if is_integer else pa.float64()
        self._labels: dict[str, pa.Field] = {}

    @property
    def fields(self) -> Sequence[pa.Field]:
        """Columns of the labels found so far."""
        return list(self._labels.values())

    def observe(self, message: Any) -> bool:
        """Add the labels of a message; return whether it has any."""
        labels = _labels(message)
        for name in labels or ():
            if name not in self._labels:
                self._labels[name] = arrow_field(name, self._kind, unit_of(name))
        return labels is not None

    def rows(self, message: Any) -> Mapping[str, Any] | None:
        """Return the values of a message; None if it has no labels."""
        labels = _labels(message)
        if labels is None:
            return None
        values = dict(zip(labels, message.data, strict=True))
        return {name: [values.get(name)] for name in self._labels}


class JsonTable:
    """A column for each key of JSON objects in texts; nested values are JSON texts."""

    def __init__(self) -> None:
        self._kinds: dict[str, set[type]] = {}

    @property
    def fields(self) -> Sequence[pa.Field]:
        """Columns of the keys found so far."""
        return [field for field, _ in self._columns.values()]

    def observe(self, message: Any) -> bool:
        """Add the keys of a message; return whether it is a JSON object."""
        found = _json_object(message.data)
        for key, value in (found or {}).items():
            self._kinds.setdefault(key, set()).add(_json_kind(value))
        return found is not None

    def rows(self, message: Any) -> Mapping[str, Any] | None:
        """Return the values of a message; None if it is no JSON object."""
        found = _json_object(message.data)
        if found is None:
            return None
        return {
            key: [None if found.get(key) is None else convert(found[key])]
            for key, (_, convert) in self._columns.items()
        }

    @cached_property
    def _columns(self) -> dict[str, tuple[pa.Field, Callable[[Any], Any]]]:
        return {key: _json_column(key, found) for key, found in self._kinds.items()}


def _labels(message: Any) -> list[str] | None:
    """Return the labels of an array; None if it has none, or one twice."""
    try:
        labels = array_label(message).split(",")
    except CodecError:
        return None
    return labels if len(set(labels)) == len(labels) else None


def _json_object(text: str) -> Mapping[str, Any] | None:
    """Return the JSON object in a text; None if it has none."""
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def _json_kind(value: Any) -> type:
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= _MAX_EXACT:
        return str  # beyond int64, or not exact as a number in other readers
    return type(value) if isinstance(value, (bool, int, float, str, type(None))) else dict


def _json_column(key: str, kinds: set[type]) -> tuple[pa.Field, Callable[[Any], Any]]:
    """Return the column of a key with values of some types."""
    found = kinds - {type(None)}
    if found == {bool}:
        return arrow_field(key, pa.bool_()), bool
    if found == {int}:
        return arrow_field(key, pa.int64(), unit_of(key)), int
    if found and found <= {int, float}:
        return arrow_field(key, pa.float64(), unit_of(key)), float
    if found <= {str}:
        return arrow_field(key, pa.string()), str
    return arrow_field(
        key, pa.string()
    ), lambda value: value if isinstance(value, str) else json.dumps(value)


def _level(value: Any) -> int:
    return value[0] if isinstance(value, bytes) else int(value)


def _nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * _NANO + int(stamp.nanosec)
