"""Strict reading of a machine file: every key is asked for once, and none is left over."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from machine_sim.machine.errors import MachineError

__all__ = ["Section"]

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


class Section:
    """A mapping of a YAML file that knows its own path, for messages a user can act on.

    Call `done` after the last key: it refuses keys nobody asked for, which are typing errors.
    """

    def __init__(self, values: object, path: str) -> None:
        """
        Args:
            values: what YAML gave for this section.
            path: where it stands, as shown in messages ("excavator.yaml: joints.boom").

        Raises:
            MachineError: `values` is no mapping.
        """
        if not isinstance(values, Mapping):
            raise MachineError(f"{path} is {values!r}; give a mapping of key: value")
        self._values = values
        self._path = path
        self._known_keys: set[str] = set()

    def has(self, key: str) -> bool:
        """Whether an optional key is there."""
        self._known_keys.add(key)
        return key in self._values

    def number(self, key: str, *, low: float = -math.inf, positive: bool = False) -> float:
        """A finite number, at least `low`, or above zero if `positive`."""
        return self._number(key, self._require(key), low, positive)

    def number_or(self, key: str, default: float) -> float:
        """A finite number, or `default` where the file says null."""
        value = self._require(key)
        return default if value is None else self._number(key, value, -math.inf, False)

    def count(self, key: str, *, low: int) -> int:
        """A whole number, at least `low`."""
        value = self._require(key)
        if isinstance(value, bool) or not isinstance(value, int) or value < low:
            raise MachineError(
                f"{self._key_path(key)} is {value!r}; give a whole number from {low} up"
            )
        return value

    def text(self, key: str) -> str:
        """A text that is not empty."""
        value = self._require(key)
        if not isinstance(value, str) or not value:
            raise MachineError(f"{self._key_path(key)} is {value!r}; give a text")
        return value

    def vector(self, key: str, length: int, *, positive: bool = False) -> tuple[float, ...]:
        """A list of `length` finite numbers."""
        return self._vector(key, self._require(key), length, positive)

    def vectors(self, key: str, count: int | None, length: int) -> tuple[tuple[float, ...], ...]:
        """A list of `count` lists of `length` finite numbers, of any count if None."""
        value = self._list(key, count)
        return tuple(
            self._vector(f"{key}[{i}]", item, length, False) for i, item in enumerate(value)
        )

    def names(self) -> list[str]:
        """All keys, of a mapping whose keys are names that the file gives.

        Raises:
            MachineError: a name that a topic cannot have.
        """
        for key in self._values:
            if not isinstance(key, str) or not _NAME.fullmatch(key):
                raise MachineError(
                    f"{self._path} names {key!r}; give a name of letters, digits and _ that begins"
                    " with a letter"
                )
        return list(self._values)

    def section(self, key: str) -> Section:
        """A mapping inside this one."""
        return Section(self._require(key), self._key_path(key))

    def sections(self, key: str) -> list[Section]:
        """A list of mappings, of any length."""
        return [
            Section(item, self._key_path(f"{key}[{i}]"))
            for i, item in enumerate(self._list(key, None))
        ]

    def reject_unknown_keys(self) -> None:
        """Refuse keys that nobody asked for.

        Raises:
            MachineError: naming them and the known ones.
        """
        unknown = sorted(str(key) for key in self._values if key not in self._known_keys)
        if unknown:
            raise MachineError(
                f"{self._path} has unknown key {', '.join(unknown)};"
                f" remove it or use one of: {', '.join(sorted(self._known_keys))}"
            )

    def _key_path(self, key: str) -> str:
        return f"{self._path}{'' if self._path.endswith(': ') else '.'}{key}"

    def _require(self, key: str) -> Any:
        self._known_keys.add(key)
        if key not in self._values:
            raise MachineError(f"{self._key_path(key)} is missing; add it")
        return self._values[key]

    def _list(self, key: str, count: int | None) -> list[Any]:
        value = self._require(key)
        if not isinstance(value, list) or (count is not None and len(value) != count):
            wanted = "a list" if count is None else f"a list of {count} entries"
            got = f"has {len(value)} entries" if isinstance(value, list) else f"is {value!r}"
            raise MachineError(f"{self._key_path(key)} {got}; give {wanted}")
        return value

    def _vector(self, key: str, value: object, length: int, positive: bool) -> tuple[float, ...]:
        if not isinstance(value, list) or len(value) != length:
            raise MachineError(
                f"{self._key_path(key)} is {value!r}; give a list of {length} numbers"
            )
        return tuple(self._number(key, item, -math.inf, positive) for item in value)

    def _number(self, key: str, value: object, low: float, positive: bool) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            # YAML takes 24e3 for a text: an exponent has a point before it and a sign.
            looks = isinstance(value, str) and re.fullmatch(r"[-+\d.]+[eE]\d+", value)
            how = ", with the exponent as in 24.0e+3" if looks else ""
            raise MachineError(f"{self._key_path(key)} is {value!r}; give a number{how}")
        if not math.isfinite(value) or value < low or (positive and value <= 0.0):
            wanted = "above 0" if positive else f"from {low:g} up" if low > -math.inf else "finite"
            raise MachineError(f"{self._key_path(key)} is {value}; give a number {wanted}")
        return float(value)
