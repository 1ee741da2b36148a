"""Limit of messages in a time: a bucket of tokens that is refilled at a constant rate."""

from __future__ import annotations

import time
from collections.abc import Callable

__all__ = ["RateLimit"]


class RateLimit:
    """Allows `rate` messages a second, and `burst` at once."""

    def __init__(
        self, rate: float, burst: float, now: Callable[[], float] = time.monotonic
    ) -> None:
        """
        Args:
            rate: messages per second.
            burst: messages that may come at once.
            now: a monotonic clock [s].
        """
        self._rate, self._burst, self._now = rate, burst, now
        self._tokens, self._last = burst, now()

    def allow(self) -> bool:
        """Return whether one more message is allowed now, and count it if it is."""
        now = self._now()
        self._tokens = min(self._burst, self._tokens + self._rate * (now - self._last))
        self._last = now
        if self._tokens < 1.0:
            return False
        self._tokens -= 1.0
        return True
