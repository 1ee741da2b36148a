"""Strict reading of one mapping of a machine file: typed values, no missing or unknown keys."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

from machine_sim.machine.errors import MachineError
from msg_bridge.contract.suggestions import did_you_mean, nearest_name, suggestion

__all__ = ["Section"]

_FILE = "the file"
"""What messages call the section of a whole file."""

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


class Section:
    """A mapping of a YAML file with its path in the file, which error messages name.

    Call `reject_unknown_keys` after the last key is read, to find misspelt keys.

    Every method that reads a key raises `MachineError` if the key is missing or its value is of
    another type or out of range.
    """

    def __init__(self, values: object, path: str) -> None:
        """
        Args:
            values: the section as parsed from YAML.
            path: path of the section in the file, for messages ("joints.boom"); empty for the file.

        Raises:
            MachineError: `values` is not a mapping.
        """
        if not isinstance(values, Mapping):
            raise MachineError(f"{path or _FILE} is {values!r}; give a mapping of key: value")
        self._values = values
        self._path = path
        self._known_keys: set[str] = set()

    def has(self, key: str) -> bool:
        """Return whether the section has an optional key."""
        self._known_keys.add(key)
        return key in self._values

    def is_text(self, key: str) -> bool:
        """Return whether the value of a key is a string."""
        return isinstance(self._require(key), str)

    def number(self, key: str, *, low: float = -math.inf, positive: bool = False) -> float:
        """Return a finite number, at least `low`, or above zero if `positive`."""
        return self._number(key, self._require(key), low, positive)

    def number_or(self, key: str, default: float) -> float:
        """Return a finite number, or `default` for null."""
        value = self._require(key)
        return default if value is None else self._number(key, value, -math.inf, False)

    def fraction(self, key: str) -> float:
        """Return a number from 0 to 1."""
        value = self.number(key, low=0.0)
        if value > 1.0:
            raise MachineError(f"{self.key_path(key)} is {value:g}; give a number from 0 to 1")
        return value

    def count(self, key: str, *, low: int) -> int:
        """Return an integer, at least `low`."""
        value = self._require(key)
        if isinstance(value, bool) or not isinstance(value, int) or value < low:
            raise MachineError(
                f"{self.key_path(key)} is {value!r}; give an integer of at least {low}"
            )
        return value

    def text(self, key: str) -> str:
        """Return a non-empty string."""
        value = self._require(key)
        if not isinstance(value, str) or not value:
            raise MachineError(f"{self.key_path(key)} is {value!r}; give a string")
        return value

    def vector(self, key: str, length: int, *, positive: bool = False) -> tuple[float, ...]:
        """Return a list of `length` finite numbers, above zero if `positive`."""
        return self._vector(key, self._require(key), length, positive)

    def vec3(self, key: str, *, positive: bool = False) -> tuple[float, float, float]:
        """Return a list of three finite numbers, above zero if `positive`."""
        x, y, z = self.vector(key, 3, positive=positive)
        return x, y, z

    def vectors(self, key: str, count: int | None, length: int) -> tuple[tuple[float, ...], ...]:
        """Return `count` lists of `length` finite numbers each; None allows any count."""
        value = self._list(key, count)
        return tuple(
            self._vector(f"{key}[{i}]", item, length, False) for i, item in enumerate(value)
        )

    def corners(self, key: str) -> tuple[tuple[float, ...], ...]:
        """Return the corners of an outline: three or more lists [u, v] or [u, v, radius]."""
        return self._corners(key, self._list(key, None))

    def corner_lists(self, key: str) -> tuple[tuple[tuple[float, ...], ...], ...]:
        """Return a list of outlines, each as from `corners`."""
        return tuple(
            self._corners(f"{key}[{i}]", item) for i, item in enumerate(self._list(key, None))
        )

    def names(self) -> list[str]:
        """Return all keys of a mapping whose keys are names chosen in the file.

        Raises:
            MachineError: a name that cannot be part of a topic name.
        """
        for key in self._values:
            if not isinstance(key, str) or not _NAME.fullmatch(key):
                raise MachineError(
                    f"{self._path or _FILE} has the name {key!r}; use letters, digits and _, a"
                    " letter first"
                )
        return list(self._values)

    def flag(self, key: str) -> bool:
        """Return true or false."""
        value = self._require(key)
        if not isinstance(value, bool):
            raise MachineError(f"{self.key_path(key)} is {value!r}; give true or false")
        return value

    def section(self, key: str) -> Section:
        """Return a mapping inside this one."""
        return Section(self._require(key), self.key_path(key))

    def sections(self, key: str) -> list[Section]:
        """Return a list of mappings, of any length."""
        return [
            Section(item, self.key_path(f"{key}[{i}]"))
            for i, item in enumerate(self._list(key, None))
        ]

    def reject_unknown_keys(self) -> None:
        """Check that every key has been read or tested for.

        Raises:
            MachineError: unknown keys; the message lists them and the known ones.
        """
        unknown = sorted(str(key) for key in self._values if key not in self._known_keys)
        if unknown:
            names = ", ".join(f"{key}{suggestion(key, self._known_keys)}" for key in unknown)
            raise MachineError(
                f"{self._path or _FILE} has unknown key {names};"
                f" remove it or use one of: {', '.join(sorted(self._known_keys))}"
            )

    def key_path(self, key: str) -> str:
        """Return the path of a key in the file, for messages."""
        return f"{self._path}.{key}" if self._path else key

    def _require(self, key: str) -> Any:
        self._known_keys.add(key)
        if key not in self._values:
            others = [str(other) for other in self._values if other not in self._known_keys]
            similar = nearest_name(key, others)
            path = self.key_path(key)
            if similar:
                raise MachineError(
                    f"{path} is missing, but there is {similar!r}{did_you_mean(key)};"
                    f" rename it, or add {key!r}"
                )
            raise MachineError(f"{path} is missing; add it")
        return self._values[key]

    def _list(self, key: str, count: int | None) -> list[Any]:
        value = self._require(key)
        if not isinstance(value, list) or (count is not None and len(value) != count):
            wanted = "a list" if count is None else f"a list of {count} entries"
            got = f"has {len(value)} entries" if isinstance(value, list) else f"is {value!r}"
            raise MachineError(f"{self.key_path(key)} {got}; give {wanted}")
        return value

    def _corners(self, key: str, value: object) -> tuple[tuple[float, ...], ...]:
        if not isinstance(value, list) or len(value) < 3:
            raise MachineError(
                f"{self.key_path(key)} is {value!r}; give a list of three or more corners"
            )
        corners = []
        for i, item in enumerate(value):
            length = len(item) if isinstance(item, list) and len(item) == 3 else 2
            corner = self._vector(f"{key}[{i}]", item, length, False)
            if length == 3 and corner[2] < 0.0:
                raise MachineError(
                    f"{self.key_path(key)}[{i}] has the radius {corner[2]:g}; give one >= 0"
                )
            corners.append(corner)
        return tuple(corners)

    def _vector(self, key: str, value: object, length: int, positive: bool) -> tuple[float, ...]:
        if not isinstance(value, list) or len(value) != length:
            raise MachineError(
                f"{self.key_path(key)} is {value!r}; give a list of {length} numbers"
            )
        return tuple(self._number(key, item, -math.inf, positive) for item in value)

    def _number(self, key: str, value: object, low: float, positive: bool) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            # YAML 1.1 parses 24e3 as a string: a float needs a decimal point and a signed exponent.
            is_exponent = isinstance(value, str) and re.fullmatch(r"[-+\d.]+[eE]\d+", value)
            hint = ", with the exponent as in 24.0e+3" if is_exponent else ""
            raise MachineError(f"{self.key_path(key)} is {value!r}; give a number{hint}")
        if not math.isfinite(value) or value < low or (positive and value <= 0.0):
            valid = (
                "above 0" if positive else f">= {low:g}" if low > -math.inf else "that is finite"
            )
            raise MachineError(f"{self.key_path(key)} is {value}; give a number {valid}")
        return float(value)
