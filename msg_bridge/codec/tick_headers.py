"""Headers, requests and the ledger as labelled Int64MultiArray; refusals as JSON.

An array is one dimension of values whose label names each of them, so that a stranger who reads
the message knows what each number is. The first, `kind`, says what it is a message of, so that
one topic carries them all::

    layout.dim[0].label  kind,run_id,machine_id,session_id,stream,first,count
    data                 3, 1, 2, 7, 1, 120, 40

The names are the dataclasses' own: what is added there is carried from then on. A refusal has a
text and so no place in an array: it is a JSON object with the dataclass's names, in a String.
"""

from __future__ import annotations

import array
import json
import typing
from collections.abc import Iterator
from dataclasses import asdict, fields, is_dataclass
from enum import IntEnum
from functools import cache
from typing import Any

from std_msgs.msg import Int64MultiArray, MultiArrayDimension, MultiArrayLayout, String

from msg_bridge.codec.cdr import array_to_cdr, cdr_to_array
from msg_bridge.codec.errors import CodecError
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import JoinRejected, MachineHeader, RetransmitRequest, SoilHeader

__all__ = [
    "ArrayKind",
    "ArrayMessage",
    "from_join_rejected_string",
    "from_multi_array",
    "message_from_cdr",
    "message_to_cdr",
    "to_join_rejected_string",
    "to_multi_array",
]

ArrayMessage = MachineHeader | SoilHeader | RetransmitRequest | Ledger


class ArrayKind(IntEnum):
    """First value of every array: what the others are."""

    MACHINE_HEADER = 1
    SOIL_HEADER = 2
    RETRANSMIT_REQUEST = 3
    LEDGER = 4


_TYPES: dict[ArrayKind, type[ArrayMessage]] = {
    ArrayKind.MACHINE_HEADER: MachineHeader,
    ArrayKind.SOIL_HEADER: SoilHeader,
    ArrayKind.RETRANSMIT_REQUEST: RetransmitRequest,
    ArrayKind.LEDGER: Ledger,
}
_KINDS = {each: kind for kind, each in _TYPES.items()}

_DERIVED: dict[type, tuple[str, ...]] = {Ledger: ("imbalance",)}
"""Properties written after the fields, for those who only look; checked when read."""


def _data(message: ArrayMessage) -> array.array[int]:
    """The values of an array.

    Raises:
        CodecError: a value that is not an int64.
    """
    kind = _KINDS[type(message)]
    values = _values(message)
    try:
        data = array.array("q", (kind, *values))
    except (OverflowError, TypeError):
        names = _names(message)
        name, wrong = next((n, v) for n, v in zip(names, values, strict=True) if not _is_int64(v))
        raise CodecError(f"{name} of a {kind.name} is {wrong!r}; it must be an int64") from None
    return data


def to_multi_array(message: ArrayMessage) -> Int64MultiArray:
    """A header, request or ledger as a message.

    Raises:
        CodecError: a value that is not an int64.
    """
    data = _data(message)
    size = len(data)
    dimension = MultiArrayDimension(label=_label(message), size=size, stride=size)
    return Int64MultiArray(layout=MultiArrayLayout(dim=[dimension], data_offset=0), data=data)


def message_to_cdr(message: ArrayMessage) -> bytes:
    """The same as the bytes of the message.

    Raises:
        CodecError: as `to_multi_array`.
    """
    return array_to_cdr(_label(message), _data(message))


def message_from_cdr(data: bytes) -> ArrayMessage | None:
    """What a message's bytes hold; None if they are laid out otherwise (`cdr_to_array`).

    Raises:
        CodecError: as `from_multi_array`.
    """
    found = cdr_to_array(data)
    return None if found is None else from_multi_array(found)


def from_multi_array(msg: Int64MultiArray) -> ArrayMessage:
    """The header, request or ledger that a message holds.

    Raises:
        CodecError: unknown kind, other labels or another number of values; says what is wrong.
    """
    size = len(msg.data)
    dims = [(dim.size, dim.stride) for dim in msg.layout.dim]
    if dims != [(size, size)] or msg.layout.data_offset:
        raise CodecError(
            f"the array has {size} values and a layout of {dims or 'no dimension'}, offset"
            f" {msg.layout.data_offset}; give one dimension of that size and stride, offset 0"
        )
    if not size or msg.data[0] not in _TYPES:
        known = ", ".join(f"{kind.value} {kind.name}" for kind in ArrayKind)
        raise CodecError(f"the array begins with {msg.data[:1].tolist()}; kinds are {known}")
    kind = ArrayKind(msg.data[0])
    values = iter(msg.data[1:])
    try:
        message: ArrayMessage = _build(_TYPES[kind], values)
    except StopIteration:
        raise CodecError(f"{size} values are too few for a {kind.name}") from None
    except ValueError as error:  # an enum's, or half a part
        raise CodecError(f"the array is no {kind.name}: {error}") from None
    made, label = _values(message), _label(message)
    if len(made) != size - 1:
        raise CodecError(f"a {kind.name} has {len(made) + 1} values ({label}), not {size}")
    if msg.layout.dim[0].label != label:
        raise CodecError(
            f"the array is labelled {msg.layout.dim[0].label!r}; a {kind.name} is {label!r}"
        )
    for name, value, found in zip(_names(message), made, msg.data[1:], strict=True):
        if value != found:  # only what is derived can differ
            raise CodecError(f"{name} of a {kind.name} is {found}; its other values make {value}")
    return message


def to_join_rejected_string(rejection: JoinRejected) -> String:
    """A refusal as JSON."""
    return String(data=json.dumps(asdict(rejection)))


def from_join_rejected_string(msg: String) -> JoinRejected:
    """The refusal that a message holds.

    Raises:
        CodecError: not JSON, or not of a refusal's names and types.
    """
    try:
        found = json.loads(msg.data)
    except (ValueError, RecursionError) as error:
        raise CodecError(f"a refusal must be JSON: {error}") from None
    types = _hints(JoinRejected)
    if not isinstance(found, dict) or any(
        type(found.get(name)) is not types.get(name) for name in {*types, *found}
    ):
        wanted = ", ".join(f"{name} ({each.__name__})" for name, each in types.items())
        raise CodecError(f"a refusal must be an object of {wanted}; it is {msg.data!r}")
    return JoinRejected(**found)


@cache
def _hints(of: type) -> dict[str, Any]:
    """Type of each field of a dataclass, in order."""
    hints = typing.get_type_hints(of)
    return {field.name: hints[field.name] for field in fields(of)}


@cache
def _fields_of(of: Any) -> tuple[str, ...]:
    """Names of a dataclass's fields, then of what is derived."""
    return (*_hints(of), *_DERIVED.get(of, ()))


def _values(message: object) -> list[int]:
    """Every number of a dataclass, depth first; then what is derived."""
    values: list[int] = []
    of: Any = type(message)
    for name in _fields_of(of):
        value = getattr(message, name)
        if isinstance(value, tuple):
            for each in value:
                values += _values(each)
        elif is_dataclass(value):
            values += _values(value)
        else:
            values.append(value)
    return values


def _names(message: object) -> tuple[str, ...]:
    """The name of each of `_values`."""
    of: Any = type(message)
    return _names_of(of, _repeats(message))


def _label(message: object) -> str:
    of: Any = type(message)
    return _label_of(of, _repeats(message))


def _repeats(message: object) -> int:
    """Parts in the message's tuple; no message has more than one."""
    return len(message.receipts) if isinstance(message, SoilHeader) else 0


@cache
def _label_of(of: Any, repeats: int) -> str:
    return ",".join(("kind", *_names_of(of, repeats)))


@cache
def _names_of(of: Any, repeats: int, prefix: str = "") -> tuple[str, ...]:
    names: list[str] = []
    hints = _hints(of)
    for name in _fields_of(of):
        kind = hints.get(name, int)
        if typing.get_origin(kind) is tuple:
            each = typing.get_args(kind)[0]
            for index in range(repeats):
                names += _names_of(each, 0, f"{prefix}{name}.{index}.")
        elif is_dataclass(kind):
            part: Any = kind
            names += _names_of(part, 0, f"{prefix}{name}.")
        else:
            names.append(prefix + name)
    return tuple(names)


def _build(of: Any, values: Iterator[int]) -> Any:
    """A dataclass, enum or number from the next values; a tuple takes all there are."""
    if typing.get_origin(of) is tuple:
        each = typing.get_args(of)[0]
        rest = list(values)
        width = len(_hints(each))
        if len(rest) % width:
            raise ValueError(f"the last {len(rest)} values are no whole {each.__name__}s")
        again = iter(rest)
        return tuple([_build(each, again) for _ in range(len(rest) // width)])
    if issubclass(of, int):  # enums are
        return of(next(values))
    return of(*[_build(each, values) for each in _hints(of).values()])


def _is_int64(value: Any) -> bool:
    return hasattr(value, "__index__") and -(2**63) <= value < 2**63
