"""Write one bag: a folder with one MCAP file that is readable up to its last chunk at any time.

Messages are collected in a chunk, which is written to the file at once when it is large enough or
`flush` is called. A recorder that is killed loses only the current chunk. What `close` adds, the
index and metadata.yaml, makes reading faster and is required by `ros2 bag`.
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import FileIO
from pathlib import Path

from mcap.records import Message

from msg_bridge.bag.mcap_file import McapFileWriter
from msg_bridge.bag.message_schemas import schema_text
from msg_bridge.bag.message_schemas import type_hash as installed_type_hash
from msg_bridge.bag.metadata import (
    BagMetadata,
    OfferedQos,
    TopicMetadata,
    to_metadata_yaml,
    to_qos_yaml,
)
from msg_bridge.contract.errors import EarthmovingError

__all__ = ["CHUNK_SIZE", "COMPRESSIONS", "BagError", "BagWriter"]

CHUNK_SIZE = 1 << 20
"""Approximate size of a chunk before compression [bytes]. Larger ones compress no better; a reader
must decompress a chunk completely for its first message."""

COMPRESSIONS = {
    "zstd": "zstd",
    "lz4": "lz4",
    "none": "",
}
"""Names of compressions in MCAP files by our names, best first. zstd makes a terrain map of rough
ground 2.8 times smaller at about 3 ms of CPU time per megabyte, lz4 2.0 times at about 1 ms.
Terrain maps are most of a bag, some MB/s: with zstd that is a few percent of one core, and a disk
stores a third more."""

_DISK_FULL_ERRNOS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_SEQUENCE_MODULUS = 2**32


class BagError(EarthmovingError):
    """A bag cannot be written to the given path."""


@dataclass
class _Topic:
    """A topic and the number of its messages so far."""

    channel: int
    type_name: str
    type_hash: str
    offered: tuple[OfferedQos, ...]
    count: int = 0


class BagWriter:
    """A bag being written.

    Attributes:
        folder: its folder.
        file: its MCAP file.
        messages: number of messages so far, those of the current chunk included.
    """

    def __init__(
        self, folder: Path, *, compression: str = "zstd", chunk_size: int = CHUNK_SIZE
    ) -> None:
        """Create the folder and the file.

        Args:
            folder: may exist if it is empty; its parents are created.
            compression: of chunks, one of COMPRESSIONS.
            chunk_size: [bytes] before compression.

        Raises:
            BagError: the folder is not empty, or it cannot be written.
        """
        if compression not in COMPRESSIONS:
            raise BagError(f"compression is {compression!r}; give one of {', '.join(COMPRESSIONS)}")
        self.folder = Path(os.path.abspath(folder))
        self.file = self.folder / f"{self.folder.name}_0.mcap"
        self.messages = 0
        self._topics: dict[str, _Topic] = {}
        self._schemas: dict[str, int] = {}
        self._first: int | None = None
        self._last = 0
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            existing = next(self.folder.iterdir(), None)
        except OSError as error:
            raise _to_bag_error(self.folder, error) from error
        if existing is not None:
            raise BagError(
                f"{self.folder} is not empty (it has {existing.name}); give another path, or move"
                " its content away"
            )
        self._stream = _AtomicFile(self.file)
        self._mcap = McapFileWriter(
            self._stream,
            profile="ros2",
            library="earthmoving_sim",
            compression=COMPRESSIONS[compression],
            chunk_size=chunk_size,
        )

    @property
    def size(self) -> int:
        """Size of the file [bytes], without the current chunk."""
        return self._stream.tell()

    @property
    def has_failed(self) -> bool:
        """Whether a write failed; nothing more can be written then."""
        return self._stream.has_failed

    @property
    def topics(self) -> tuple[str, ...]:
        """Names of the topics, in the order they were added."""
        return tuple(self._topics)

    def add_topic(
        self,
        topic: str,
        type_name: str,
        offered: Sequence[OfferedQos] = (),
        advertised_hash: str | None = None,
    ) -> None:
        """Add a topic.

        Args:
            topic: its name.
            type_name: as `std_msgs/msg/String`.
            offered: QoS offered by each of its publishers.
            advertised_hash: type hash that its publishers advertise; by default that of the
                installed type.

        Raises:
            SchemaError: the type is not installed.
            BagError: the topic was added before, or the bag cannot be written.
        """
        if topic in self._topics:
            raise BagError(f"{topic} was already added to the bag; add each topic once")
        type_hash = advertised_hash or installed_type_hash(type_name)
        if type_name not in self._schemas:
            text = schema_text(type_name).encode()
            self._schemas[type_name] = self._mcap.add_schema(type_name, "ros2msg", text)
        unique = tuple(dict.fromkeys(offered))
        metadata = {"offered_qos_profiles": to_qos_yaml(unique), "topic_type_hash": type_hash}
        channel = self._mcap.add_channel(topic, self._schemas[type_name], metadata)
        self._topics[topic] = _Topic(channel, type_name, type_hash, unique)

    def write(
        self, topic: str, data: bytes, log_time: int, publish_time: int, sequence: int = 0
    ) -> None:
        """Add a message.

        Args:
            topic: an added topic.
            data: its CDR bytes.
            log_time, publish_time: times of reception and publication [ns].
            sequence: sequence number of its publisher, stored modulo 2**32.

        Raises:
            BagError: the bag cannot be written.
        """
        entry = self._topics[topic]
        self._mcap.add_message(
            Message(entry.channel, log_time, data, publish_time, sequence % _SEQUENCE_MODULUS)
        )
        entry.count += 1
        self.messages += 1
        self._first = log_time if self._first is None else min(self._first, log_time)
        self._last = max(self._last, log_time)

    def attach(self, name: str, media_type: str, data: bytes, time: int) -> None:
        """Add a file as an attachment, at once; arguments are as of `McapFileWriter`.

        Raises:
            BagError: the bag cannot be written.
        """
        self._mcap.add_attachment(name, media_type, data, time)

    def flush(self) -> None:
        """Write the current chunk to the file, so that it is not lost if the process is killed.

        Raises:
            BagError: the bag cannot be written.
        """
        self._mcap.write_chunk()

    def close(self, custom: Mapping[str, str] | None = None) -> None:
        """Finish the file and write metadata.yaml; a second call does nothing.

        After a failed write the file is left as it is, with all chunks written before.

        Args:
            custom: custom data of metadata.yaml, by name.

        Raises:
            BagError: the bag cannot be written.
        """
        if self._stream.closed:
            return
        try:
            if not self._stream.has_failed:
                self._mcap.finish()
        finally:
            self._stream.close()
        if not self._stream.has_failed:
            self._write_metadata(to_metadata_yaml(self._build_metadata(custom or {})))

    def _build_metadata(self, custom: Mapping[str, str]) -> BagMetadata:
        topics = tuple(
            TopicMetadata(name, each.type_name, each.type_hash, each.offered, each.count)
            for name, each in self._topics.items()
        )
        return BagMetadata(
            file=self.file.name,
            topics=topics,
            first=self._first,
            last=None if self._first is None else self._last,
            custom=custom,
        )

    def _write_metadata(self, text: str) -> None:
        path = self.folder / "metadata.yaml"
        part = path.with_suffix(".part")
        try:
            part.write_text(text, encoding="utf-8")
            part.replace(path)  # atomically, so that readers never find an incomplete file
        except OSError as error:
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)
            raise _to_bag_error(path, error) from error


class _AtomicFile:
    """An unbuffered file in which each write succeeds completely or leaves no trace.

    Attributes:
        has_failed: whether a write failed; the file ends with the one before.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._size = 0
        self.has_failed = False
        try:
            self._raw = FileIO(path, "xb")
        except OSError as error:
            raise _to_bag_error(path, error) from error

    @property
    def closed(self) -> bool:
        return self._raw.closed

    def write(self, data: bytes) -> int:
        if self.has_failed:
            raise BagError(f"an earlier write to {self._path} failed; start another bag")
        remaining = memoryview(data)
        try:
            while remaining:
                remaining = remaining[self._raw.write(remaining) :]
        except OSError as error:
            self.has_failed = True
            with contextlib.suppress(OSError):
                self._raw.truncate(self._size)
            raise _to_bag_error(self._path, error) from error
        self._size += len(data)
        return len(data)

    def tell(self) -> int:
        return self._size

    def close(self) -> None:
        self._raw.close()


def _to_bag_error(path: Path, error: OSError) -> BagError:
    reason = error.strerror or str(error)
    if error.errno in _DISK_FULL_ERRNOS:
        return BagError(
            f"there is no disk space for {path} ({reason}); free some, or record elsewhere. What"
            " was recorded before can be read"
        )
    return BagError(f"{path} cannot be written ({reason}); give a writable path")
