"""Checks of the numbers in a command."""

from __future__ import annotations

import math
import reprlib
from array import array
from typing import Any

import numpy as np

from machine_sim.commands.errors import CommandError

__all__ = ["format_value", "validate_number", "validate_numbers", "validate_time"]


_MAX_VALUE_LENGTH = 160
"""Maximum number of characters of a value in a message."""

_MAX_NUMBERS = reprlib.aRepr.maxlist
"""Maximum number of numbers of an array in a message."""


def format_value(value: Any) -> str:
    """Return a value as text for an error message, truncated if it is long.

    The numbers of an array, as ROS messages have them, are those of a list that a user writes.
    """
    if isinstance(value, np.ndarray):
        value = value.tolist()
    elif isinstance(value, array):
        shown = value[: _MAX_NUMBERS + 1]  # `reprlib` replaces the last one by dots
        is_float32 = shown.typecode == "f"  # 0.1 of an axis is 0.10000000149011612
        value = [float(f"{each:.7g}") for each in shown] if is_float32 else shown.tolist()
    text = reprlib.repr(value)  # limits each level of nesting, not their sum
    return text if len(text) <= _MAX_VALUE_LENGTH else text[: _MAX_VALUE_LENGTH - 3] + "..."


def validate_numbers(values: Any, what: str, expected: str) -> list[float]:
    """Return a sequence of finite numbers as floats.

    Args:
        values: a list, tuple, array or any other input; None counts as empty.
        what: name of the values in the error message.
        expected: what to give, for the error message.

    Raises:
        CommandError: not a flat sequence of numbers, or a number that is not finite.
    """
    try:
        numbers = np.asarray(() if values is None else values)
    except (TypeError, ValueError, OverflowError):
        numbers = np.empty((), dtype=object)
    if numbers.ndim != 1 or numbers.dtype.kind not in "iuf":
        raise CommandError(
            f"{what} is {format_value(values)}, not a list of numbers; give {expected}"
        )
    if not np.isfinite(numbers).all():
        raise CommandError(
            f"{what} {format_value(values)} has a number that is not finite; give {expected}"
        )
    floats: list[float] = numbers.astype(np.float64).tolist()
    return floats


def validate_number(value: Any, what: str, expected: str) -> float:
    """Return one finite number as a float; arguments as for `validate_numbers`.

    Raises:
        CommandError: not a finite number.
    """
    if isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool):
        try:
            result = float(value)
        except OverflowError:
            result = math.inf
        if math.isfinite(result):
            return result
    raise CommandError(f"{what} is {format_value(value)}; give {expected}")


def validate_time(now: Any) -> float:
    """Return the time of an arrival or a tick [s].

    Raises:
        CommandError: not a finite number.
    """
    return validate_number(now, "the time", "finite seconds of one clock, the same for all calls")
