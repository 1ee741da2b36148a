"""Writes one bag: a folder with one MCAP file, whole at any time up to its last chunk.

Messages are gathered in chunks; a chunk goes to the file in one piece when it is large enough or
`flush` is called. A recorder that is killed so loses the chunk it was gathering and nothing else.
What `close` adds, index and metadata.yaml, only makes reading faster and `ros2 bag` content.
"""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from typing import IO, cast

from mcap.writer import CompressionType, Writer

from msg_bridge.bag.message_schemas import schema_text, type_hash
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
"""Bytes of a chunk before compression, about. Larger ones compress no better; a reader has to
unpack a whole one for its first message."""

COMPRESSIONS = {
    "zstd": CompressionType.ZSTD,
    "lz4": CompressionType.LZ4,
    "none": CompressionType.NONE,
}
"""By name, best first. A terrain map of rough ground becomes 2.8 times smaller with zstd for about
3 ms of CPU time a megabyte, 2.0 times with lz4 for about 1 ms. Terrain maps are most of a bag, some
MB/s: with zstd that is a few percent of one core, and the disk holds a third more."""

_DISK_FULL_ERRNOS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_SEQUENCE_MODULUS = 2**32


class BagError(EarthmovingError):
    """A bag cannot be written where it is to be written."""


@dataclass
class _Topic:
    """A topic and how far it is."""

    channel: int
    type_name: str
    type_hash: str
    offered: tuple[OfferedQos, ...]
    count: int = 0


class BagWriter:
    """A bag being written.

    Attributes:
        folder: where it is.
        file: its MCAP file.
        messages: written so far, those of the chunk being gathered included.
    """

    def __init__(
        self, folder: Path, *, compression: str = "zstd", chunk_size: int = CHUNK_SIZE
    ) -> None:
        """Make the folder and begin the file.

        Args:
            folder: may exist if it is empty; those above it are made.
            compression: of chunks, one of COMPRESSIONS.
            chunk_size: [bytes] before compression.

        Raises:
            BagError: there is something in the folder, or it cannot be written.
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
            taken = next(self.folder.iterdir(), None)
        except OSError as error:
            raise _to_bag_error(self.folder, error) from error
        if taken is not None:
            raise BagError(
                f"{self.folder} is not empty ({taken.name} is there); give another path, or move"
                " what is there away"
            )
        self._stream = _AtomicFile(self.file)
        # It needs no more of a stream than _File has.
        self._mcap = Writer(
            cast(IO[bytes], self._stream),
            chunk_size=chunk_size,
            compression=COMPRESSIONS[compression],
        )
        self._mcap.start(profile="ros2", library="earthmoving_sim")

    @property
    def size(self) -> int:
        """Bytes in the file; what is being gathered is not yet."""
        return self._stream.tell()

    @property
    def has_failed(self) -> bool:
        """Whether a write has failed; nothing more can be written then."""
        return self._stream.has_failed

    @property
    def topics(self) -> tuple[str, ...]:
        """Names of its topics, in the order they were added."""
        return tuple(self._topics)

    def add_topic(
        self,
        topic: str,
        type_name: str,
        offered: Sequence[OfferedQos] = (),
        hash_of_type: str | None = None,
    ) -> None:
        """Make room for a topic's messages.

        Args:
            topic: its name.
            type_name: as `std_msgs/msg/String`.
            offered: by each of its publishers.
            hash_of_type: as publishers tell it; by default that of the installed type.

        Raises:
            SchemaError: the type is not installed.
            BagError: the topic is there already, or the bag cannot be written.
        """
        if topic in self._topics:
            raise BagError(f"{topic} is in the bag already; a topic has one type")
        hash_of_type = hash_of_type or type_hash(type_name)
        if type_name not in self._schemas:
            text = schema_text(type_name).encode()
            self._schemas[type_name] = self._mcap.register_schema(type_name, "ros2msg", text)
        unique = tuple(dict.fromkeys(offered))
        metadata = {"offered_qos_profiles": to_qos_yaml(unique), "topic_type_hash": hash_of_type}
        schema = self._schemas[type_name]
        channel = self._mcap.register_channel(topic, "cdr", schema, metadata)
        self._topics[topic] = _Topic(channel, type_name, hash_of_type, unique)

    def write(
        self, topic: str, data: bytes, log_time: int, publish_time: int, sequence: int = 0
    ) -> None:
        """Add a message.

        Args:
            topic: one that was added.
            data: its CDR, as it came.
            log_time, publish_time: when it arrived and was sent [ns].
            sequence: its publisher's number, kept modulo 2**32.

        Raises:
            BagError: the bag cannot be written.
        """
        about = self._topics[topic]
        self._mcap.add_message(
            about.channel, log_time, data, publish_time, sequence=sequence % _SEQUENCE_MODULUS
        )
        about.count += 1
        self.messages += 1
        self._first = log_time if self._first is None else min(self._first, log_time)
        self._last = max(self._last, log_time)

    def flush(self) -> None:
        """End the chunk being gathered, so that a kill cannot lose it.

        Raises:
            BagError: the bag cannot be written.
        """
        self._mcap.flush()  # type: ignore[no-untyped-call]

    def close(self, custom: Mapping[str, str] | None = None) -> None:
        """Finish the file and write metadata.yaml; a second call does nothing.

        A bag whose file could not be written is left as it is: all its whole chunks are there.

        Args:
            custom: for metadata.yaml, by name.

        Raises:
            BagError: the bag cannot be written.
        """
        if self._stream.closed:
            return
        try:
            if not self._stream.has_failed:
                self._mcap.finish()  # type: ignore[no-untyped-call]
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
        half = path.with_suffix(".part")
        try:
            half.write_text(text, encoding="utf-8")
            half.replace(path)  # whoever sees it sees all of it
        except OSError as error:
            with contextlib.suppress(OSError):
                half.unlink(missing_ok=True)
            raise _to_bag_error(path, error) from error


class _AtomicFile:
    """A file without buffer in which every write stands as a whole or not at all.

    Attributes:
        broken: a write failed; the file ends with the one before.
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
            raise BagError(f"{self._path} could not be written before; begin another bag")
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._raw.write(rest) :]
        except OSError as error:
            self.has_failed = True
            with contextlib.suppress(OSError):
                self._raw.truncate(self._size)
            raise _to_bag_error(self._path, error) from error
        self._size += len(data)
        return len(data)

    def tell(self) -> int:
        return self._size

    def flush(self) -> None:
        """Nothing is held back."""

    def close(self) -> None:
        self._raw.close()


def _to_bag_error(path: Path, error: OSError) -> BagError:
    what = error.strerror or str(error)
    if error.errno in _DISK_FULL_ERRNOS:
        return BagError(
            f"there is no room for {path} ({what}); free some, or record elsewhere. What was"
            " recorded until now can be read"
        )
    return BagError(f"{path} cannot be written ({what}); give a path that can")
