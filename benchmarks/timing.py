"""Wall times, and measurements of several cases in turn."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

__all__ = ["elapsed_ms", "interleave", "percentile_99"]

T = TypeVar("T")


def elapsed_ms(work: Callable[[], object]) -> float:
    """Return the wall time of a call [ms]."""
    start = time.perf_counter()
    work()
    return 1e3 * (time.perf_counter() - start)


def interleave(cases: Sequence[Callable[[], T]], runs: int) -> list[list[T]]:
    """Call all cases in turn, `runs` times, so that a change of load affects all of them.

    Returns:
        The results, [run][case].
    """
    return [[case() for case in cases] for _ in range(runs)]


def percentile_99(times: Sequence[float]) -> float:
    """Return the 99th percentile of some times."""
    return float(np.percentile(times, 99))
