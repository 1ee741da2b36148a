"""Messages of any type with values and lengths that no sender means."""

from __future__ import annotations

import array
import re
from collections.abc import Iterator
from importlib import import_module
from typing import Any

from sensor_msgs.msg import PointCloud2

__all__ = ["LARGE_CLOUD_SIZE", "hostile_messages", "large_cloud"]

LARGE_CLOUD_SIZE = 100_000_000
"""Size of a large cloud [bytes]."""

_FLOATS = {"float": 3.0e38, "double": 1.0e308}
_INTEGERS = re.compile(r"(u?)int(\d+)|octet|char")
_SEQUENCE = re.compile(r"sequence<(.+?)(?:, \d+)?>")
_ARRAY = re.compile(r"(.+)\[(\d+)\]")

_LONG = 20_000
"""Length of a long sequence or text."""


def hostile_messages(kind: type) -> Iterator[tuple[str, Any]]:
    """Yield messages of a type with a name for each."""
    yield "empty", kind()
    for name, factor, length in (
        ("not a number", float("nan"), 3),
        ("infinite", float("inf"), 3),
        ("large", 1.0, 3),
        ("large negative", -1.0, 3),
        ("long", 1.0, _LONG),
    ):
        yield name, _filled(kind, factor, length)


def large_cloud() -> PointCloud2:
    """Return a cloud of 100 MB whose layout is none of the exchange."""
    cloud = PointCloud2(height=1, width=LARGE_CLOUD_SIZE // 16, point_step=16)
    cloud.row_step = LARGE_CLOUD_SIZE
    cloud.data = array.array("B", bytes(LARGE_CLOUD_SIZE))
    return cloud


def _filled(kind: type, factor: float, length: int) -> Any:
    message = kind()
    for field, type_name in kind.get_fields_and_field_types().items():  # type: ignore[attr-defined]
        value = _value(type_name, factor, length)
        if value is not None:
            setattr(message, field, value)
    return message


def _value(type_name: str, factor: float, length: int) -> Any:
    """Return a value for a field; None leaves its default."""
    if type_name in _FLOATS:
        return factor * _FLOATS[type_name]
    if type_name in ("boolean", "string"):
        return True if type_name == "boolean" else "x" * length
    integer = _INTEGERS.fullmatch(type_name)
    if integer:
        bits, is_unsigned = int(integer[2] or 8), bool(integer[1]) or integer[2] is None
        if is_unsigned:
            return 2**bits - 1
        return 2 ** (bits - 1) - 1 if factor > 0.0 else -(2 ** (bits - 1))
    sequence = _SEQUENCE.fullmatch(type_name)
    if sequence:
        return _values(sequence[1], factor, length)
    fixed = _ARRAY.fullmatch(type_name)
    if fixed:
        return _values(fixed[1], factor, int(fixed[2]))
    package, _, name = type_name.partition("/")
    return _filled(getattr(import_module(f"{package}.msg"), name), factor, min(length, 3))


def _values(type_name: str, factor: float, length: int) -> list[Any]:
    if "/" in type_name:  # messages in messages
        length = min(length, 100)
    return [_value(type_name, factor, min(length, 50)) for _ in range(length)]
