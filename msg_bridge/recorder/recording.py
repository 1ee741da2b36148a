"""Write received messages into a bag, repeat transient-local ones, and count losses."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from msg_bridge.bag.message_loss import MessageLossCounter
from msg_bridge.bag.metadata import OfferedQos
from msg_bridge.bag.terrain_deltas import (
    CLOUD_TYPE,
    deltas_topic,
    is_map_topic,
    map_topic_of_deltas,
)
from msg_bridge.count_text import count_text
from msg_bridge.raw_topics.received_message import ReceivedMessage, TransientLocalHistory
from msg_bridge.recorder.background_writer import BackgroundWriter
from msg_bridge.recorder.input_files import InputFileRecording
from msg_bridge.recorder.params import RecorderParams
from msg_bridge.recorder.terrain_recording import TerrainRecording

__all__ = ["FORMAT_VERSION", "BagRecording"]

FORMAT_VERSION = "2"
"""Version of the names of topics, fields and keys; `bag.legacy_names` upgrades older ones."""

_MEGA = 1e6
_NANO = 10**9
_MAX_DISORDER = _NANO
"""Time by which log times of successive messages may be out of order [ns]."""


@dataclass
class _RepeatedTopic:
    """A transient-local topic whose newest messages are written repeatedly."""

    history: TransientLocalHistory
    last_write_time: int = 0  # log time [ns]


class BagRecording:
    """A bag being recorded, with its statistics.

    Attributes:
        loss_counter: counts lost messages and rows.
        input_files: adds the files that the nodes have read.
        messages, num_bytes: number and size of received messages, without repetitions.
    """

    def __init__(
        self,
        writer: BackgroundWriter,
        params: RecorderParams,
        *,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        """Begin without topics.

        Args:
            writer: the bag.
            params: what is repeated, and when a file is complete.
            now: a monotonic clock [s], for rates.
        """
        self.loss_counter = MessageLossCounter()
        self.input_files = InputFileRecording(writer)
        self.messages = 0
        self.num_bytes = 0
        self._messages_in_file = 0
        self._writer = writer
        self._repeat_period = round(params.repeat_transient_local_period * _NANO)
        self._keyframe_period = round(params.terrain_keyframe_period * _NANO)
        self._max_size = params.max_bagfile_size
        self._max_duration = round(params.max_bagfile_duration * _NANO)
        self._file_start: int | None = None  # log time of the first message of the file [ns]
        self._transient_local: dict[str, _RepeatedTopic] = {}
        self._terrain: dict[str, TerrainRecording] = {}
        self._now = now
        self._rate_state = (now(), 0, 0.0)  # time [s], bytes then, last rate [bytes/s]

    @property
    def path(self) -> str:
        """The bag's folder."""
        return self._writer.path

    @property
    def topics(self) -> tuple[str, ...]:
        """Names of the topics, in the order they were added."""
        return self._writer.topics

    @property
    def has_failed(self) -> bool:
        """Whether a write failed and raised `BagError`."""
        return self._writer.has_failed

    def add_topic(
        self, topic: str, type_name: str, offered: Sequence[OfferedQos], type_hash: str | None
    ) -> None:
        """Add a topic, as `BagWriter.add_topic`."""
        self._writer.add_topic(topic, type_name, offered, type_hash)
        self.loss_counter.add_topic(topic, type_name)
        self.input_files.add_topic(topic, type_name)
        if self._keyframe_period and is_map_topic(topic, type_name):
            self._terrain[topic] = TerrainRecording(self._keyframe_period)

    def update_publishers(
        self, topic: str, publishers: frozenset[bytes], *, transient_local: bool
    ) -> None:
        """Update the publishers of a topic from the ROS graph.

        Args:
            topic: an added topic.
            publishers: identities of its publishers (GIDs).
            transient_local: whether all of them are transient local.
        """
        self.loss_counter.update_publishers(topic, publishers)
        if publishers:  # a bag is played: its deltas need their full maps
            self._terrain.pop(map_topic_of_deltas(topic, CLOUD_TYPE) or "", None)
        if transient_local:
            repeated = self._transient_local.setdefault(
                topic, _RepeatedTopic(TransientLocalHistory(topic))
            )
            repeated.history.set_depth(len(publishers))
        elif publishers:
            self._transient_local.pop(topic, None)

    def write(self, message: ReceivedMessage, log_time: int) -> None:
        """Write a message.

        Args:
            message: the message.
            log_time: [ns].

        Raises:
            BagError: the bag cannot be written.
        """
        self._split_if_due(log_time)
        if not self._write_map_or_message(message, log_time):
            self.loss_counter.add_dropped(message.topic, message.sequence_number)
            return
        self.input_files.add_message(message, log_time)
        self.messages += 1
        self.num_bytes += len(message.data)
        self.loss_counter.add(message.topic, message.data, message.sequence_number)
        repeated = self._transient_local.get(message.topic)
        if repeated is not None:
            repeated.history.messages.append(message)
            repeated.last_write_time = log_time

    def repeat_transient_local(self, log_time: int) -> None:
        """Write transient-local messages again that were not written for one period.

        They keep their publish time and sequence number, which distinguishes them from new ones.
        Terrain maps have the period of their keyframes.

        Args:
            log_time: the current log time [ns].

        Raises:
            BagError: the bag cannot be written.
        """
        if not self._repeat_period:
            return
        for topic, repeated in self._transient_local.items():
            terrain = self._terrain.get(topic)
            elapsed = log_time - repeated.last_write_time
            is_due = (
                # A reset of the simulation time counts as an elapsed period.
                not 0 <= elapsed < self._repeat_period
                if terrain is None
                else terrain.is_keyframe_due(log_time)
            )
            if is_due:
                self._repeat(repeated, log_time)

    def _repeat(self, repeated: _RepeatedTopic, log_time: int) -> None:
        # Not before the message itself, whose publish time would be after the log time then.
        if 0 < repeated.last_write_time - log_time < _MAX_DISORDER:
            log_time = repeated.last_write_time
        for message in repeated.history.messages:
            self._write_message(message, log_time)
        repeated.last_write_time = log_time

    def _split_if_due(self, log_time: int) -> None:
        """Begin another file if the current one is large or long enough."""
        if self._file_start is None:
            self._file_start = log_time
        is_full = bool(self._max_size) and self._writer.file_size >= self._max_size
        # Log times of successive messages may be out of order, or begin again after a reset.
        duration = abs(log_time - self._file_start)
        is_long = 0 < self._max_duration <= duration
        if not is_full and not is_long:
            return
        self._writer.split()
        self._file_start = log_time
        for terrain in self._terrain.values():
            terrain.begin_file()
        # Each file is readable without those before.
        for repeated in self._transient_local.values():
            self._repeat(repeated, log_time)

    def _write_map_or_message(self, message: ReceivedMessage, log_time: int) -> bool:
        """Write a message, a terrain map as a delta if it can be; return whether it is queued."""
        terrain = self._terrain.get(message.topic)
        delta = None if terrain is None else terrain.delta(message.data, log_time)
        if delta is None:
            return self._write_message(message, log_time)
        topic = deltas_topic(message.topic)
        if topic not in self._writer.topics:
            self.add_topic(topic, CLOUD_TYPE, [OfferedQos()], None)
        return self._write_message(message._replace(topic=topic, data=delta), log_time)

    def _write_message(self, message: ReceivedMessage, log_time: int) -> bool:
        """Write a message in full; return whether it is queued."""
        is_queued = self._writer.write(
            message.topic, message.data, log_time, message.source_time, message.sequence_number
        )
        terrain = self._terrain.get(message.topic)
        if is_queued and terrain is not None:
            terrain.add_keyframe(message.data, log_time)
        return is_queued

    def flush(self) -> None:
        """Have all written messages moved to the file.

        Raises:
            BagError: the bag cannot be written.
        """
        messages = self.messages

        def note_messages() -> None:
            self._messages_in_file = messages

        self._writer.flush(note_messages)

    def close(self) -> None:
        """Finish the bag.

        The custom data of its metadata.yaml has the format of the messages (`format_version`) and
        the number of lost messages by topic (`lost`, JSON).

        Raises:
            BagError: the bag cannot be written.
        """
        custom = {"format_version": FORMAT_VERSION, "lost": json.dumps(self.loss_counter.lost)}
        self._writer.close(custom)

    def status(self) -> dict[str, Any]:
        """Return the content of `/recorder/status`.

        - `path`: folder of the bag
        - `topics`, `messages`, `bytes`: number of recorded topics, messages and bytes
        - `bytes_on_disk`: size of the bag so far, in which messages are compressed [bytes]
        - `bytes_queued`: size of the messages that wait for the disk [bytes]
        - `files`: number of the bag's files
        - `messages_in_file`: number of messages that a killed recorder leaves in the file
        - `num_lost`: number of lost messages, or rows where rows are numbered
        - `lost`: the same by topic, of topics with losses
        - `uncounted`: topics with several publishers, whose losses cannot be counted
        - `input_files`: number of files that the nodes have read and the bag has as attachments
        - `missing_files`: path of each such file that the bag lacks, by parameter
        """
        return {
            "path": self.path,
            "topics": len(self.topics),
            "messages": self.messages,
            "messages_in_file": self._messages_in_file,
            "bytes": self.num_bytes,
            "bytes_on_disk": self._writer.size,
            "bytes_queued": self._writer.queue_size,
            "files": self._writer.num_files,
            "num_lost": self.loss_counter.total,
            "lost": self.loss_counter.lost,
            "uncounted": self.loss_counter.uncounted,
            "input_files": len(self.input_files.attached),
            "missing_files": self.input_files.missing,
        }

    def progress(self) -> str:
        """Return a line with the current statistics."""
        last_time, last_bytes, rate = self._rate_state
        elapsed = self._now() - last_time
        if elapsed > 0.0:
            rate = (self.num_bytes - last_bytes) / elapsed
            self._rate_state = (self._now(), self.num_bytes, rate)
        return (
            f"{count_text(self.messages, 'message')}, {self._writer.size / _MEGA:.1f} MB on disk,"
            f" {rate / _MEGA:.2f} MB/s received, {self.loss_text()}"
        )

    def summary(self) -> str:
        """Return a line on the whole recording."""
        size = self._writer.size / _MEGA
        content = (
            f"{count_text(self.messages, 'message')} on {count_text(len(self.topics), 'topic')}"
        )
        return f"{self.path}: {content}, {size:.1f} MB on disk, {self.loss_text()}"

    def missing_files_text(self) -> str:
        """Return which input files the bag lacks as text; empty if it has all."""
        missing = ", ".join(f"{path} ({name})" for name, path in self.input_files.missing.items())
        if not missing:
            return ""
        return (
            f"the bag lacks {missing}: changed since the node read it, or on another computer; keep"
            " it for a replay, or run the recorder on the computer of that node"
        )

    def loss_text(self) -> str:
        """Return the losses by topic as text."""
        lost = self.loss_counter.lost
        if not lost:
            return "nothing lost"
        return "lost " + ", ".join(f"{count} on {topic}" for topic, count in lost.items())
