"""Suggest the name that an unknown one may be a misspelling of."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

__all__ = ["did_you_mean", "nearest_name", "suggestion"]

_MIN_SIMILARITY = 0.6
"""Smallest similarity ratio, from 0 to 1, at which a name is suggested."""


def nearest_name(name: str, known: Iterable[str]) -> str | None:
    """Return the known name most similar to a name; None if none is similar."""
    matches = difflib.get_close_matches(name, list(known), n=1, cutoff=_MIN_SIMILARITY)
    return matches[0] if matches else None


def did_you_mean(nearest: str | None, place: str = "") -> str:
    """Return " (did you mean 'width'?)"; empty without a name.

    Args:
        nearest: the suggested name.
        place: where it is, such as " in section task"; added to the question.
    """
    return f" (did you mean {nearest!r}{place}?)" if nearest else ""


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return " (did you mean 'width'?)" for an unknown name; empty if no known one is similar."""
    return did_you_mean(nearest_name(name, known))
