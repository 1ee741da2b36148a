"""What becomes of a message that was heard: it is numbered, kept if latched, and written."""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from msg_bridge.bag.gaps import Gaps
from msg_bridge.bag.metadata import OfferedQos
from msg_bridge.bag.writer import BagWriter

__all__ = ["Heard", "Recording"]

_MEGA = 1e6
_NANO = 10**9


class Heard(NamedTuple):
    """A message as it came.

    Attributes:
        data: its CDR.
        arrived, sent: wall time [ns].
        number: its publisher's, from 1; 0 if unknown.
    """

    topic: str
    data: bytes
    arrived: int
    sent: int
    number: int


@dataclass
class _Latched:
    """The newest messages of a latched topic, one for each of its publishers.

    Messages do not say whose they are, so with several publishers the newest of one may push out
    that of another.
    """

    kept: deque[Heard] = field(default_factory=lambda: deque(maxlen=1))
    written: int = 0  # log time [ns]

    def make_room(self, publishers: int) -> None:
        if publishers != self.kept.maxlen:
            self.kept = deque(self.kept, maxlen=max(publishers, 1))


class Recording:
    """A bag being recorded, with its figures.

    Attributes:
        gaps: what was lost.
        messages, data_bytes: heard so far; not what was written again.
    """

    def __init__(
        self,
        writer: BagWriter,
        latched_period: float,
        *,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            latched_period: [s] of log time after which latched messages are written again; 0 for
                never.
            now: the wall clock [s], for rates.
        """
        self.gaps = Gaps()
        self.messages = 0
        self.data_bytes = 0
        self._writer = writer
        self._period = round(latched_period * _NANO)
        self._latched: dict[str, _Latched] = {}
        self._now = now
        self._rate = (now(), 0, 0.0)  # since when, bytes then, the last rate [bytes/s]

    @property
    def path(self) -> str:
        """The bag's folder."""
        return str(self._writer.folder)

    @property
    def topics(self) -> tuple[str, ...]:
        """Names of its topics, in the order they were added."""
        return self._writer.topics

    @property
    def broken(self) -> bool:
        """Whether the bag could not be written, and `BagError` was raised."""
        return self._writer.broken

    def add_topic(
        self, topic: str, type_name: str, offered: Sequence[OfferedQos], type_hash: str | None
    ) -> None:
        """As `BagWriter.add_topic`."""
        self._writer.add_topic(topic, type_name, offered, type_hash)
        self.gaps.add_topic(topic, type_name)

    def see_publishers(self, topic: str, publishers: frozenset[bytes], *, latched: bool) -> None:
        """Take what the graph shows of a topic now.

        Args:
            topic: one that was added.
            publishers: their identities.
            latched: whether all of them keep their newest messages for late subscribers.
        """
        self.gaps.see_publishers(topic, publishers)
        if latched and self._period:
            self._latched.setdefault(topic, _Latched()).make_room(len(publishers))
        elif publishers:
            self._latched.pop(topic, None)

    def write(self, heard: Heard, log_time: int) -> None:
        """Write a message.

        Raises:
            BagError: the bag cannot be written.
        """
        self._writer.write(heard.topic, heard.data, log_time, heard.sent, heard.number)
        self.messages += 1
        self.data_bytes += len(heard.data)
        self.gaps.add(heard.topic, heard.data, heard.number)
        latched = self._latched.get(heard.topic)
        if latched is not None:
            latched.kept.append(heard)
            latched.written = log_time

    def repeat_latched(self, log_time: int) -> None:
        """Write latched messages again that were not written for their period.

        They keep the time and the number of their publisher, which tells them from new ones.

        Raises:
            BagError: the bag cannot be written.
        """
        for latched in self._latched.values():
            # Simulation time that was set back counts as elapsed.
            if 0 <= log_time - latched.written < self._period:
                continue
            for heard in latched.kept:
                self._writer.write(heard.topic, heard.data, log_time, heard.sent, heard.number)
            latched.written = log_time

    def flush(self) -> None:
        """Give what was written to the file.

        Raises:
            BagError: the bag cannot be written.
        """
        self._writer.flush()

    def close(self) -> None:
        """Finish the bag; what was lost stands in its metadata.yaml, under `lost`.

        Raises:
            BagError: the bag cannot be written.
        """
        self._writer.close({"lost": json.dumps(self.gaps.lost)})

    def status(self) -> dict[str, Any]:
        """Figures for others.

        - `path`: the bag's folder
        - `topics`, `messages`, `bytes`: recorded so far
        - `gaps`: messages lost, counted as rows where rows are numbered; `lost`: the same by topic
        - `uncounted`: topics of several publishers, of whose losses nothing can be told
        """
        return {
            "path": self.path,
            "topics": len(self.topics),
            "messages": self.messages,
            "bytes": self.data_bytes,
            "gaps": self.gaps.total,
            "lost": self.gaps.lost,
            "uncounted": self.gaps.uncounted,
        }

    def progress(self) -> str:
        """How it goes, in a line."""
        since, before, rate = self._rate
        elapsed = self._now() - since
        if elapsed > 0.0:
            rate = (self.data_bytes - before) / elapsed
            self._rate = (self._now(), self.data_bytes, rate)
        return (
            f"{self.messages} messages, {self.data_bytes / _MEGA:.1f} MB,"
            f" {rate / _MEGA:.2f} MB/s, {self.gaps_text()}"
        )

    def summary(self) -> str:
        """What was recorded, in a line."""
        size = self._writer.size / _MEGA
        topics = len(self.topics)
        return (
            f"{self.path}: {self.messages} messages on {topics} topics, {size:.1f} MB on disk,"
            f" {self.gaps_text()}"
        )

    def gaps_text(self) -> str:
        """What was lost on which topics."""
        lost = self.gaps.lost
        if not lost:
            return "no gaps"
        return "lost " + ", ".join(f"{count} on {topic}" for topic, count in lost.items())
