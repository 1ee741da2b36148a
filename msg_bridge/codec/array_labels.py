"""Labels of dataclasses encoded as arrays of int64, and the places of known labels in a message.

The names are those of the dataclasses' fields: a field added there is encoded from then on. The
fields of a nested dataclass are joined by a dot, those of the items of a tuple are numbered::

    kind,run_id,tick,...,forces.first,forces.count,receipts.0.machine_id,receipts.0.session_id,...

Names that are not known are skipped when a message is decoded, so that later versions may append
values: to the end of the array, or to the end of each item of the tuple.
"""

from __future__ import annotations

import re
import typing
from dataclasses import fields, is_dataclass
from functools import cache, lru_cache
from itertools import pairwise
from typing import Any

from msg_bridge.codec.errors import CodecError
from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.ledger import Ledger

__all__ = [
    "ABSENT",
    "DERIVED_PROPERTIES",
    "KIND_LABEL",
    "field_types",
    "known_labels",
    "label_positions",
]

_OPTIONAL_SUFFIXES = ("digest", "answered_tick")
"""Ends of the labels that arrays of earlier versions, in bags, may lack; their value is 0 then."""

ABSENT = -1
"""Position of an optional label that an array lacks."""

KIND_LABEL = "kind"
"""Name of the first value of every array."""

DERIVED_PROPERTIES: dict[type, tuple[str, ...]] = {Ledger: ("imbalance",)}
"""Properties encoded behind the fields, for readers without this package; checked when decoded."""


@cache
def field_types(of: type) -> dict[str, Any]:
    """Return the type of each field of a dataclass, by name and in order."""
    hints = typing.get_type_hints(of)
    return {field.name: hints[field.name] for field in fields(of)}


@cache
def known_labels(of: type, num_items: int) -> tuple[str, ...]:
    """Return the names of all values of a message, `kind` first.

    Args:
        of: its dataclass.
        num_items: number of items of its tuple; no message has more than one tuple.
    """
    derived = DERIVED_PROPERTIES.get(of, ())
    return (KIND_LABEL, *_labels(of, num_items, ""), *derived)


@lru_cache(maxsize=256)
def label_positions(of: type, label: str) -> tuple[int, ...]:
    """Return the position of each known label in a message; ABSENT for an optional one it lacks.

    Args:
        of: the dataclass of the message.
        label: names of all values of the message, joined by commas.

    Raises:
        CodecError: LABELS: a known label is missing, repeated or in another place.
    """
    names = label.split(",")
    position = {name: k for k, name in enumerate(names)}
    known = known_labels(of, _num_items(of, names))
    found = tuple(position.get(name, ABSENT) for name in known)
    is_complete = all(
        k != ABSENT or name.endswith(_OPTIONAL_SUFFIXES)
        for name, k in zip(known, found, strict=True)
    )
    present = [k for k in found if k != ABSENT]
    num_fixed = sum(k != ABSENT for k in found[: len(known_labels(of, 0))])
    in_place = present[:num_fixed] == list(range(num_fixed))
    in_order = all(a < b for a, b in pairwise(present))
    if len(position) < len(names) or not (is_complete and in_place and in_order):
        raise CodecError(
            f"the array is labelled {label!r}; the label of a {of.__name__} begins with"
            f" {','.join(known)!r}",
            ErrorCode.LABELS,
        )
    return found


def _num_items(of: type, names: list[str]) -> int:
    """Return how many items of the tuple the labels number; no more than there are labels."""
    for name, kind in field_types(of).items():
        if typing.get_origin(kind) is tuple:
            pattern = re.compile(rf"{name}\.(\d+)\.")
            return len({match[1] for each in names if (match := pattern.match(each))})
    return 0


def _labels(of: type, num_items: int, prefix: str) -> list[str]:
    names: list[str] = []
    for name, kind in field_types(of).items():
        if typing.get_origin(kind) is tuple:
            item = typing.get_args(kind)[0]
            for index in range(num_items):
                names += _labels(item, 0, f"{prefix}{name}.{index}.")
        elif is_dataclass(kind):
            part: Any = kind
            names += _labels(part, 0, f"{prefix}{name}.")
        else:
            names.append(prefix + name)
    return names
