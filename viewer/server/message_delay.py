"""MessageDelay: how late the lever messages of a client arrive.

A connection that stalls keeps what the driver sends, and delivers it when it continues. Messages
have a time by the clock of the client, whose offset to that of the server is unknown. The smallest
difference between arrival and that time belongs to a message without delay; a larger one is by its
delay larger.
"""

from __future__ import annotations

import math

__all__ = ["MAX_DELAY", "MessageDelay"]

MAX_DELAY = 0.3
"""Delay above which a lever message is ignored [s]; as long as a driver may be silent."""

_MAX_DRIFT = 1e-3
"""Maximum drift of the two clocks against each other [s/s]."""

_REST_TIME = 1.0
"""Time for which late messages must hold no lever before the offset is measured again [s]. A clock
that stands still while its computer sleeps makes all later messages late; those of a stall arrive
at once."""


class MessageDelay:
    """Measures the delay of the messages of one client."""

    def __init__(self) -> None:
        self._offset = math.inf
        self._last_arrival = math.inf
        self._rest_start: float | None = None
        self._rest_offset = math.inf

    def is_late(self, sent: float, now: float, *, is_at_rest: bool) -> bool:
        """Return whether a message arrives too late to move a lever.

        Args:
            sent: time of the message, by the clock of the client [s].
            now: time of its arrival, by the clock of the server [s].
            is_at_rest: whether the message holds no lever.
        """
        difference = now - sent
        self._offset += _MAX_DRIFT * max(now - self._last_arrival, 0.0)
        self._last_arrival = now
        self._offset = min(self._offset, difference)
        if difference - self._offset <= MAX_DELAY:
            self._rest_start = None
            return False
        if not is_at_rest:
            self._rest_start = None
        elif self._rest_start is None:
            self._rest_start, self._rest_offset = now, difference
        else:
            self._rest_offset = min(self._rest_offset, difference)
            if now - self._rest_start >= _REST_TIME:
                self._offset, self._rest_start = self._rest_offset, None
        return True
