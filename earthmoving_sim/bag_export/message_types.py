"""Definitions of the recorded message types, and messages decoded by them.

The bag has the definition of each type, so types that are not installed are read, too.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from msg_bridge.bag.message_schemas import SchemaError
from msg_bridge.bag.reader import BagReader
from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.raw_topics.raw_subscriptions import message_class

__all__ = ["Field", "MessageTypes", "UnreadableTypeError"]


class UnreadableTypeError(EarthmovingError):
    """The definition of a message type is missing or cannot be used."""


class Field(NamedTuple):
    """A field of a message type.

    Attributes:
        name: its name.
        type: `float64` or another primitive type, or a message type such as `std_msgs/msg/Header`.
        is_message: whether it is a message type.
        length: None for a single value, 0 for a sequence, else the length of an array.
    """

    name: str
    type: str
    is_message: bool
    length: int | None


class MessageTypes:
    """Message types of a bag."""

    def __init__(self, reader: BagReader) -> None:
        self._reader = reader
        self._store = get_typestore(Stores.EMPTY)
        self._failed: dict[str, str] = {}
        for name, text in reader.type_definitions.items():
            self._add(name, text)

    def _add(self, name: str, text: str) -> None:
        try:
            types = get_types_from_msg(text, name)
            known = self._store.fielddefs
            self._store.register({key: each for key, each in types.items() if key not in known})
        except Exception as error:  # rosbags raises several kinds for invalid texts
            self._failed[name] = str(error)

    def fields(self, type_name: str) -> list[Field]:
        """Return the fields of a message type, in their order.

        Raises:
            UnreadableTypeError: the bag has no usable definition of it.
        """
        if type_name not in self._store.fielddefs:
            reason = self._failed.get(type_name, "the bag has no definition of it")
            raise UnreadableTypeError(f"{type_name} cannot be decoded: {reason}")
        return [_to_field(name, node) for name, node in self._store.fielddefs[type_name][1]]

    def decoder(self, topic: str) -> Callable[[bytes, int], Any]:
        """Return a function that decodes the messages of a topic from CDR bytes and log time [ns].

        Installed types are decoded with their current names (`BagReader.decode`).

        Raises:
            UnreadableTypeError: as of `fields`.
        """
        kind = self._reader.topics[topic].type
        self.fields(kind)
        try:
            message_class(kind)
        except SchemaError:
            return lambda data, time: self._store.deserialize_cdr(data, kind)
        return lambda data, time: self._reader.decode(topic, data, time)


def _to_field(name: str, node: Any) -> Field:
    kind, value = node
    if kind is Nodetype.BASE:
        return Field(name, value[0], False, None)
    if kind is Nodetype.NAME:
        return Field(name, value, True, None)
    (inner_kind, inner), length = value
    type_name = inner if inner_kind is Nodetype.NAME else inner[0]
    return Field(
        name, type_name, inner_kind is Nodetype.NAME, length if kind is Nodetype.ARRAY else 0
    )
