"""Wait for what other threads do."""

import time
from collections.abc import Callable
from typing import Any

__all__ = ["until"]

DEADLINE = 20.0


def until(condition: Callable[[], Any]) -> None:
    """Call `condition` again and again until it returns a true value.

    Raises:
        AssertionError: it did not within `DEADLINE` [s, wall time].
    """
    deadline = time.monotonic() + DEADLINE
    while not condition():
        assert time.monotonic() < deadline, "the condition did not hold in time"
        time.sleep(0.002)
