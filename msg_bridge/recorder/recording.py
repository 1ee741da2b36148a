"""What becomes of a message that was heard: it is numbered, kept if latched, and written."""

from __future__ import annotations

import json
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from msg_bridge.bag.message_loss import MessageLossCounter
from msg_bridge.bag.metadata import OfferedQos
from msg_bridge.bag.writer import BagWriter

__all__ = ["BagRecording", "RecordedMessage"]

_MEGA = 1e6
_NANO = 10**9


class RecordedMessage(NamedTuple):
    """A message as it came.

    Attributes:
        data: its CDR.
        arrived, sent: wall time [ns].
        number: its publisher's, from 1; 0 if unknown.
    """

    topic: str
    data: bytes
    received_time: int
    source_time: int
    sequence_number: int


@dataclass
class _TransientLocalHistory:
    """The newest messages of a latched topic, one for each of its publishers.

    Messages do not say whose they are, so with several publishers the newest of one may push out
    that of another.
    """

    messages_kept: deque[RecordedMessage] = field(default_factory=lambda: deque(maxlen=1))
    last_write_time: int = 0  # log time [ns]

    def set_depth(self, publishers: int) -> None:
        if publishers != self.messages_kept.maxlen:
            self.messages_kept = deque(self.messages_kept, maxlen=max(publishers, 1))


class BagRecording:
    """A bag being recorded, with its figures.

    Attributes:
        gaps: what was lost.
        messages, num_bytes: heard so far; not what was written again.
    """

    def __init__(
        self,
        writer: BagWriter,
        repeat_transient_local_period: float,
        *,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            repeat_transient_local_period: [s] of log time after which latched messages are written again; 0 for
                never.
            now: the wall clock [s], for rates.
        """
        self.loss_counter = MessageLossCounter()
        self.messages = 0
        self.num_bytes = 0
        self._writer = writer
        self._repeat_period = round(repeat_transient_local_period * _NANO)
        self._transient_local: dict[str, _TransientLocalHistory] = {}
        self._now = now
        self._rate_state = (now(), 0, 0.0)  # since when, bytes then, the last rate [bytes/s]

    @property
    def path(self) -> str:
        """The bag's folder."""
        return str(self._writer.folder)

    @property
    def topics(self) -> tuple[str, ...]:
        """Names of its topics, in the order they were added."""
        return self._writer.topics

    @property
    def has_failed(self) -> bool:
        """Whether the bag could not be written, and `BagError` was raised."""
        return self._writer.has_failed

    def add_topic(
        self, topic: str, type_name: str, offered: Sequence[OfferedQos], type_hash: str | None
    ) -> None:
        """As `BagWriter.add_topic`."""
        self._writer.add_topic(topic, type_name, offered, type_hash)
        self.loss_counter.add_topic(topic, type_name)

    def update_publishers(
        self, topic: str, publishers: frozenset[bytes], *, transient_local: bool
    ) -> None:
        """Take what the graph shows of a topic now.

        Args:
            topic: one that was added.
            publishers: their identities.
            latched: whether all of them keep their newest messages for late subscribers.
        """
        self.loss_counter.update_publishers(topic, publishers)
        if transient_local and self._repeat_period:
            self._transient_local.setdefault(topic, _TransientLocalHistory()).set_depth(
                len(publishers)
            )
        elif publishers:
            self._transient_local.pop(topic, None)

    def write(self, heard: RecordedMessage, log_time: int) -> None:
        """Write a message.

        Raises:
            BagError: the bag cannot be written.
        """
        self._writer.write(
            heard.topic, heard.data, log_time, heard.source_time, heard.sequence_number
        )
        self.messages += 1
        self.num_bytes += len(heard.data)
        self.loss_counter.add(heard.topic, heard.data, heard.sequence_number)
        transient_local = self._transient_local.get(heard.topic)
        if transient_local is not None:
            transient_local.messages_kept.append(heard)
            transient_local.last_write_time = log_time

    def repeat_transient_local(self, log_time: int) -> None:
        """Write latched messages again that were not written for their period.

        They keep the time and the number of their publisher, which tells them from new ones.

        Raises:
            BagError: the bag cannot be written.
        """
        for transient_local in self._transient_local.values():
            # Simulation time that was set back counts as elapsed.
            if 0 <= log_time - transient_local.last_write_time < self._repeat_period:
                continue
            for heard in transient_local.messages_kept:
                self._writer.write(
                    heard.topic, heard.data, log_time, heard.source_time, heard.sequence_number
                )
            transient_local.last_write_time = log_time

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
        self._writer.close({"lost": json.dumps(self.loss_counter.lost)})

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
            "bytes": self.num_bytes,
            "num_lost": self.loss_counter.total,
            "lost": self.loss_counter.lost,
            "uncounted": self.loss_counter.uncounted,
        }

    def progress(self) -> str:
        """How it goes, in a line."""
        since, before, rate = self._rate_state
        elapsed = self._now() - since
        if elapsed > 0.0:
            rate = (self.num_bytes - before) / elapsed
            self._rate_state = (self._now(), self.num_bytes, rate)
        return (
            f"{self.messages} messages, {self.num_bytes / _MEGA:.1f} MB,"
            f" {rate / _MEGA:.2f} MB/s, {self.loss_text()}"
        )

    def summary(self) -> str:
        """What was recorded, in a line."""
        size = self._writer.size / _MEGA
        topics = len(self.topics)
        return (
            f"{self.path}: {self.messages} messages on {topics} topics, {size:.1f} MB on disk,"
            f" {self.loss_text()}"
        )

    def loss_text(self) -> str:
        """What was lost on which topics."""
        lost = self.loss_counter.lost
        if not lost:
            return "no gaps"
        return "lost " + ", ".join(f"{count} on {topic}" for topic, count in lost.items())
