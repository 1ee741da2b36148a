"""Progress of reading a bag, on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable

__all__ = ["reading_progress"]


def reading_progress() -> Callable[[float], None] | None:
    """Return a function that prints the fraction of a bag that is read; None without a terminal."""
    return _print_fraction if sys.stderr.isatty() else None


def _print_fraction(fraction: float) -> None:
    end = "\n" if fraction >= 1.0 else "\r"
    print(f"  reading {100.0 * fraction:3.0f} %", end=end, file=sys.stderr, flush=True)
