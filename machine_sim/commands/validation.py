"""Checks of the numbers in a command: finite, and as many as there must be."""

from __future__ import annotations

import math
import reprlib
from typing import Any

import numpy as np

from machine_sim.commands.errors import CommandError

__all__ = ["format_value", "validate_number", "validate_numbers", "validate_time"]


_MAX_VALUE_LENGTH = 160
"""Most characters of a value in a message."""


def format_value(value: Any) -> str:
    """A value as text for an error, cut short when it is long."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    text = reprlib.repr(value)  # which keeps each level short, but not all of them together
    return text if len(text) <= _MAX_VALUE_LENGTH else text[: _MAX_VALUE_LENGTH - 3] + "..."


def validate_numbers(values: Any, what: str, instead: str) -> list[float]:
    """A sequence of finite numbers as floats.

    Args:
        values: a list, tuple, array or anything else that came in; None counts as empty.
        what: what it is, for the error.
        instead: what to give, for the error.

    Raises:
        CommandError: not a flat sequence of numbers, or one is not finite.
    """
    try:
        array = np.asarray(() if values is None else values)
    except (TypeError, ValueError, OverflowError):
        array = np.empty((), dtype=object)
    if array.ndim != 1 or array.dtype.kind not in "iuf":
        raise CommandError(f"{what} is {format_value(values)}, no list of numbers; give {instead}")
    if not np.isfinite(array).all():
        raise CommandError(
            f"{what} {format_value(values)} has a number that is not finite; give {instead}"
        )
    floats: list[float] = array.astype(np.float64).tolist()
    return floats


def validate_number(value: Any, what: str, instead: str) -> float:
    """One finite number as a float.

    Raises:
        CommandError: it is something else.
    """
    if isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool):
        try:
            result = float(value)
        except OverflowError:
            result = math.inf
        if math.isfinite(result):
            return result
    raise CommandError(f"{what} is {format_value(value)}; give {instead}")


def validate_time(now: Any) -> float:
    """The time of an arrival or a tick [s].

    Raises:
        CommandError: not a finite number.
    """
    return validate_number(now, "the time", "finite seconds of one clock, the same for all calls")
