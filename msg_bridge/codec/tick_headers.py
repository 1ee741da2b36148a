"""Headers, retransmit requests and the ledger as labelled Int64MultiArray; rejections as JSON.

An array is one dimension of values whose label names each value. The first value, `kind`, states
what the array is, so that one topic can carry several kinds of message::

    layout.dim[0].label  kind,run_id,machine_id,session_id,stream,first,count
    data                 3, 1, 2, 7, 1, 120, 40

See `array_labels` for the names. A rejection contains a text, which has no place in an array: it
is a JSON object with the dataclass's names, in a String.
"""

from __future__ import annotations

import array
import json
import typing
from collections.abc import Callable, Iterator
from dataclasses import asdict, is_dataclass, replace
from enum import IntEnum
from functools import cache
from typing import Any

from builtin_interfaces.msg import Time
from std_msgs.msg import Int64MultiArray, MultiArrayDimension, MultiArrayLayout, String

from msg_bridge.codec.array_labels import (
    ABSENT,
    DERIVED_PROPERTIES,
    field_types,
    known_labels,
    label_positions,
)
from msg_bridge.codec.cdr import array_to_cdr, cdr_to_array
from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.exchange_key import ExchangeKey
from msg_bridge.codec.json_object import parse_json_object
from msg_bridge.codec.labelled_array import array_label
from msg_bridge.contract.errors import ErrorCode
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
    "with_stamp",
]

ArrayMessage = MachineHeader | SoilHeader | RetransmitRequest | Ledger


class ArrayKind(IntEnum):
    """First value of every array: the kind of message."""

    MACHINE_HEADER = 1
    SOIL_HEADER = 2
    RETRANSMIT_REQUEST = 3
    LEDGER = 4


_CODE_LABELS = ",code.0,code.1"
"""End of the label of an array with an authentication code."""

_TYPES: dict[ArrayKind, type[ArrayMessage]] = {
    ArrayKind.MACHINE_HEADER: MachineHeader,
    ArrayKind.SOIL_HEADER: SoilHeader,
    ArrayKind.RETRANSMIT_REQUEST: RetransmitRequest,
    ArrayKind.LEDGER: Ledger,
}
_KINDS = {each: kind for kind, each in _TYPES.items()}


def to_multi_array(message: ArrayMessage) -> Int64MultiArray:
    """Encode a header, request or ledger as a message.

    Raises:
        CodecError: VALUE: not an int64.
    """
    data = _data(message)
    size = len(data)
    dimension = MultiArrayDimension(label=_label(message), size=size, stride=size)
    return Int64MultiArray(layout=MultiArrayLayout(dim=[dimension], data_offset=0), data=data)


def message_to_cdr(message: ArrayMessage, key: ExchangeKey | None = None) -> bytes:
    """Encode a header, request or ledger as a serialised message.

    Args:
        message: the message.
        key: key of the code that it ends with; None: no code.

    Raises:
        CodecError: VALUE: not an int64.
    """
    label, values = _label(message), _data(message)
    if key is not None:
        values.extend(key.code(label, values.tobytes()))
        label += _CODE_LABELS
    return array_to_cdr(label, values)


def message_from_cdr(data: bytes, key: ExchangeKey | None = None) -> ArrayMessage | None:
    """Decode a serialised message; None if its layout is not the usual one (`cdr_to_array`).

    Args:
        data: the CDR bytes.
        key: as for `from_multi_array`.

    Raises:
        CodecError: as `from_multi_array`.
    """
    found = cdr_to_array(data)
    return None if found is None else from_multi_array(found, key)


def from_multi_array(msg: Int64MultiArray, key: ExchangeKey | None = None) -> ArrayMessage:
    """Decode a header, request or ledger; values with unknown labels are left out.

    Args:
        msg: the array.
        key: key of the code that it must end with; None: a code is not checked.

    Raises:
        CodecError: LAYOUT, MESSAGE_KIND, LABELS, VALUE or AUTHENTICATION.
    """
    label = array_label(msg)
    if key is not None:
        _check_code(msg, label, key)
    if not msg.data or msg.data[0] not in _TYPES:
        known = ", ".join(f"{kind.value} {kind.name}" for kind in ArrayKind)
        raise CodecError(
            f"the array begins with {list(msg.data[:1])}; the kinds are {known}",
            ErrorCode.MESSAGE_KIND,
        )
    kind = ArrayKind(msg.data[0])
    of: type = _TYPES[kind]
    values = [0 if k == ABSENT else msg.data[k] for k in label_positions(of, label)]
    try:
        message: ArrayMessage = _builder(of)(iter(values[1:]))
    except ValueError as error:  # not a member of an enumeration
        raise CodecError(f"the array is not a {kind.name}: {error}", ErrorCode.VALUE) from None
    for name, value in zip(reversed(_derived(of)), reversed(values), strict=False):
        if value != getattr(message, name):
            raise CodecError(
                f"{name} of a {kind.name} is {value}; its other values give"
                f" {getattr(message, name)}",
                ErrorCode.VALUE,
            )
    return message


def with_stamp(ledger: Ledger, stamp: Time) -> Ledger:
    """Return a ledger with the simulation time at the end of its tick."""
    return replace(ledger, stamp_sec=stamp.sec, stamp_nanosec=stamp.nanosec)


def to_join_rejected_string(rejection: JoinRejected, key: ExchangeKey | None = None) -> String:
    """Encode a rejection as JSON, with an authentication code if a key is given."""
    values = asdict(rejection)
    if key is not None:
        values["code"] = _rejection_code(rejection, key)
    return String(data=json.dumps(values))


def from_join_rejected_string(msg: String, key: ExchangeKey | None = None) -> JoinRejected:
    """Decode a rejection.

    Args:
        msg: the JSON.
        key: key of its authentication code; None: a code is not checked.

    Raises:
        CodecError: JSON: not a JSON object with the names and types of a rejection;
            AUTHENTICATION.
    """
    types = field_types(JoinRejected)
    if key is None:
        return JoinRejected(**parse_json_object(msg.data, types, "a rejection"))
    values = parse_json_object(msg.data, {**types, "code": list}, "an authenticated rejection")
    code = values.pop("code")
    rejection = JoinRejected(**values)
    if code != _rejection_code(rejection, key):
        raise CodecError(
            "a rejection does not have the code of the exchange key; give all nodes the same"
            " exchange_key_file",
            ErrorCode.AUTHENTICATION,
        )
    return rejection


def _rejection_code(rejection: JoinRejected, key: ExchangeKey) -> list[int]:
    return [*key.code("rejection", json.dumps(asdict(rejection)).encode())]


def _check_code(msg: Int64MultiArray, label: str, key: ExchangeKey) -> None:
    """Check the authentication code at the end of an array.

    Raises:
        CodecError: AUTHENTICATION.
    """
    content = array.array("q", msg.data[:-2]).tobytes()
    code = key.code(label.removesuffix(_CODE_LABELS), content)
    if not label.endswith(_CODE_LABELS) or tuple(msg.data[-2:]) != code:
        raise CodecError(
            "a header or request does not have the code of the exchange key; give all nodes the"
            " same exchange_key_file",
            ErrorCode.AUTHENTICATION,
        )


def _data(message: ArrayMessage) -> array.array[int]:
    """Return the values of an array.

    Raises:
        CodecError: VALUE: not an int64.
    """
    kind = _KINDS[type(message)]
    values = [kind, *_values(message)]
    try:
        return array.array("q", values)
    except (OverflowError, TypeError):
        of: type = type(message)
        names = known_labels(of, _num_items(message))
        name, wrong = next((n, v) for n, v in zip(names, values, strict=True) if not _is_int64(v))
        raise CodecError(
            f"{name} of a {kind.name} is {wrong!r}; give an int64", ErrorCode.VALUE
        ) from None


def _values(message: object) -> list[int]:
    """Return all numbers of a dataclass, depth first, then its derived properties."""
    values: list[int] = []
    of: Any = type(message)
    for name in (*field_types(of), *_derived(of)):
        value = getattr(message, name)
        if isinstance(value, tuple):
            for item in value:
                values += _values(item)
        elif is_dataclass(value):
            values += _values(value)
        else:
            values.append(value)
    return values


def _label(message: ArrayMessage) -> str:
    of: type = type(message)
    return _joined_labels(of, _num_items(message))


@cache
def _joined_labels(of: type, num_items: int) -> str:
    return ",".join(known_labels(of, num_items))


def _num_items(message: ArrayMessage) -> int:
    """Return the number of items of the message's tuple; no message has more than one tuple."""
    return len(message.receipts) if isinstance(message, SoilHeader) else 0


def _derived(of: type) -> tuple[str, ...]:
    return DERIVED_PROPERTIES.get(of, ())


@cache
def _builder(of: Any) -> Callable[[Iterator[int]], Any]:
    """Return what makes a dataclass, enumeration member or number from the next values.

    A tuple takes all values that are left. It raises ValueError for a value that is not a member of
    an enumeration.
    """
    if typing.get_origin(of) is tuple:
        item = typing.get_args(of)[0]
        build_item, size = _builder(item), len(field_types(item))

        def build_tuple(values: Iterator[int]) -> Any:
            rest = list(values)
            again = iter(rest)
            return tuple([build_item(again) for _ in range(len(rest) // size)])

        return build_tuple
    if of is int:
        return next
    if issubclass(of, int):  # as enumerations are
        return lambda values: of(next(values))
    builders = [_builder(each) for each in field_types(of).values()]
    return lambda values: of(*[build(values) for build in builders])


def _is_int64(value: Any) -> bool:
    return hasattr(value, "__index__") and -(2**63) <= value < 2**63
