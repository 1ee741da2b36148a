"""Which message of a bag is due when: rate, pause, seek, loop, and keyframes first."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["MessageTimes", "Playback"]

_NANO = 10**9


class MessageTimes(Protocol):
    """Order and times of the messages, as of `msg_bridge.bag.message_index.MessageIndex`."""

    times: NDArray[np.int64]
    topic_numbers: NDArray[np.int64]

    @property
    def size(self) -> int:
        """Number of messages."""

    def latest(self, topic: str, end: int) -> int | None:
        """Return the last message of a topic before number `end`; None without one."""


class Playback:
    """The position in a bag, which moves with a clock.

    At the begin, after a seek and at each loop the keyframes are due first: of each transient-local
    topic the newest message before the position, and then the updates that these lack. The position
    moves on when they are published.

    Attributes:
        duration: of the bag [s].
        rate: seconds of the bag per second.
        is_paused: whether the position stands still.
        time_behind: time by which playing was slower than the rate, in all [s of wall time].
    """

    def __init__(
        self,
        messages: MessageTimes,
        *,
        keyframe_topics: Collection[str],
        find_updates: Callable[[str, int, int], Collection[int]],
        start: float = 0.0,
        end: float = 0.0,
        rate: float = 1.0,
        is_looping: bool = False,
        is_paused: bool = False,
    ) -> None:
        """
        Args:
            messages: at least one message.
            keyframe_topics: transient-local topics.
            find_updates: returns the messages with the updates that a keyframe lacks: of a topic of
                keyframes, of one with this number, of those before number `end`.
            start, end: what is played [s from the first message]; end 0: to the last message.
            rate: seconds of the bag per second.
            is_looping: whether to begin again at the end.
            is_paused: whether to begin paused.
        """
        self._messages = messages
        self._keyframe_topics, self._find_updates = tuple(keyframe_topics), find_updates
        self._first = int(messages.times[0])
        self.duration = (int(messages.times[-1]) - self._first) / _NANO
        self._start = min(start, self.duration)
        self._end = min(end, self.duration) if end else self.duration
        self._end_number = self._number_at(self._end, side="right")
        self.rate, self.is_paused, self._is_looping = rate, is_paused, is_looping
        self.time_behind = 0.0
        self._last_now: float | None = None
        self.seek(self._start)

    @property
    def position(self) -> float:
        """Present position [s from the first message]."""
        return self._position

    @property
    def log_time(self) -> int:
        """Log time of the position [ns]."""
        return self._first + round(self._position * _NANO)

    @property
    def is_finished(self) -> bool:
        """Whether everything has been taken, and no loop follows."""
        is_at_end = self._number >= self._end_number and self._position >= self._end
        return is_at_end and not self._keyframes and not self._is_looping

    def seek(self, position: float) -> None:
        """Go to a position [s from the first message]; it is limited to what is played."""
        self._position = min(max(position, self._start), self._end)
        self._number = self._number_at(self._position, side="left")
        self._keyframes = deque(self._find_keyframes(self._number))
        self.has_sought = True

    def take(self, now: float, max_count: int) -> list[int]:
        """Return the numbers of the messages that are due, in their order.

        If more are due than `max_count`, the position falls back to the last one returned.

        Args:
            now: a monotonic clock [s].
            max_count: maximum number.
        """
        elapsed = 0.0 if self._last_now is None else now - self._last_now
        self._last_now = now
        if self._keyframes:
            count = min(max_count, len(self._keyframes))
            return [self._keyframes.popleft() for _ in range(count)]
        if self.is_paused or self.is_finished:
            return []
        target = min(self._position + elapsed * self.rate, self._end)
        end = min(self._number_at(target, side="right"), self._end_number)
        first, self._number = self._number, max(min(end, self._number + max_count), self._number)
        if self._number < end:
            reached = (int(self._messages.times[self._number]) - self._first) / _NANO
            self.time_behind += max(target - reached, 0.0) / self.rate
            target = max(reached, self._position)
        self._position = target
        taken = list(range(first, self._number))
        if self._is_looping and not taken and self._position >= self._end:
            self.seek(self._start)
        return taken

    def take_next(self) -> list[int]:
        """Return the pending keyframes and the next message, as a step while paused."""
        taken = [*self._keyframes]
        self._keyframes.clear()
        if self._number < self._end_number:
            taken.append(self._number)
            time = int(self._messages.times[self._number]) - self._first
            self._position = max(time / _NANO, self._position)
            self._number += 1
        return taken

    def _number_at(self, position: float, *, side: str) -> int:
        time = self._first + round(position * _NANO)
        return int(np.searchsorted(self._messages.times, time, side=side))  # type: ignore[call-overload]

    def _find_keyframes(self, end: int) -> list[int]:
        """Return the messages that make up the state before message `end`: keyframes, updates."""
        keyframes: list[int] = []
        updates: list[int] = []
        for topic in self._keyframe_topics:
            keyframe = self._messages.latest(topic, end)
            if keyframe is not None:
                keyframes.append(keyframe)
                updates += self._find_updates(topic, keyframe, end)
        return sorted(keyframes) + sorted(updates)
