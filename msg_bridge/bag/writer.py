"""Write one bag: a folder with MCAP files that are readable up to their last chunk at any time.

Messages are collected in a chunk, which is written to the file at once when it is large enough or
`flush` is called. A recorder that is killed loses only the current chunk. What `close` adds, the
index and metadata.yaml, makes reading faster and is required by `ros2 bag`.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from msg_bridge.bag.atomic_file import BagError, write_error
from msg_bridge.bag.bag_file import BagFile
from msg_bridge.bag.message_schemas import type_hash as installed_type_hash
from msg_bridge.bag.metadata import (
    BagMetadata,
    FileMetadata,
    OfferedQos,
    TopicMetadata,
    to_metadata_yaml,
)

__all__ = ["CHUNK_SIZE", "COMPRESSIONS", "BagError", "BagWriter", "write_metadata"]

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


class BagWriter:
    """A bag being written.

    Attributes:
        folder: its folder.
        messages: number of messages so far, those of the current chunk included.
        num_files: number of its files so far.
    """

    def __init__(
        self, folder: Path, *, compression: str = "zstd", chunk_size: int = CHUNK_SIZE
    ) -> None:
        """Create the folder and the first file.

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
        self.messages = 0
        self.num_files = 0
        self._compression, self._chunk_size = COMPRESSIONS[compression], chunk_size
        self._topics: dict[str, TopicMetadata] = {}
        self._counts: dict[str, int] = {}  # of messages by topic
        self._completed: list[FileMetadata] = []
        self._completed_size = 0  # bytes
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            existing = next(self.folder.iterdir(), None)
        except OSError as error:
            raise write_error(self.folder, error) from error
        if existing is not None:
            raise BagError(
                f"{self.folder} is not empty (it has {existing.name}); give another path, or move"
                " its content away"
            )
        self._file = self._begin_file()

    @property
    def file(self) -> Path:
        """The MCAP file that is being written."""
        return self._file.path

    @property
    def file_size(self) -> int:
        """Size of that file [bytes], without the current chunk."""
        return self._file.size

    @property
    def size(self) -> int:
        """Size of all files [bytes], without the current chunk."""
        return self._completed_size + self._file.size

    @property
    def has_failed(self) -> bool:
        """Whether a write failed; nothing more can be written then."""
        return self._file.has_failed

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
        entry = TopicMetadata(topic, type_name, type_hash, tuple(dict.fromkeys(offered)), 0)
        self._file.add_topic(entry)
        self._topics[topic] = entry
        self._counts[topic] = 0

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
        self._file.write(topic, data, log_time, publish_time, sequence)
        self._counts[topic] += 1
        self.messages += 1

    def attach(self, name: str, media_type: str, data: bytes, time: int) -> None:
        """Add a file as an attachment, at once; arguments are as of `McapFileWriter`.

        Raises:
            BagError: the bag cannot be written.
        """
        self._file.attach(name, media_type, data, time)

    def flush(self) -> None:
        """Write the current chunk to the file, so that it is not lost if the process is killed.

        Raises:
            BagError: the bag cannot be written.
        """
        self._file.flush()

    def split(self) -> None:
        """Finish the current file and begin the next, which has all topics too.

        Raises:
            BagError: the bag cannot be written.
        """
        self._file.close()
        self._completed.append(self._file.metadata)
        self._completed_size += self._file.size
        self._file = self._begin_file()
        for topic in self._topics.values():
            self._file.add_topic(topic)

    def close(self, custom: Mapping[str, str] | None = None) -> None:
        """Finish the file and write metadata.yaml; a second call does nothing.

        After a failed write the file is left as it is, with all chunks written before.

        Args:
            custom: custom data of metadata.yaml, by name.

        Raises:
            BagError: the bag cannot be written.
        """
        if self._file.closed:
            return
        self._file.close()
        if not self._file.has_failed:
            metadata = BagMetadata(
                files=(*self._completed, self._file.metadata),
                topics=tuple(
                    replace(each, count=self._counts[each.name]) for each in self._topics.values()
                ),
                custom=custom or {},
            )
            write_metadata(self.folder, metadata)

    def _begin_file(self) -> BagFile:
        path = self.folder / f"{self.folder.name}_{self.num_files}.mcap"
        self.num_files += 1
        return BagFile(path, compression=self._compression, chunk_size=self._chunk_size)


def write_metadata(folder: Path, metadata: BagMetadata) -> None:
    """Write metadata.yaml, atomically, so that readers never find an incomplete file.

    Args:
        folder: folder of the bag.
        metadata: its content.

    Raises:
        BagError: it cannot be written.
    """
    path = folder / "metadata.yaml"
    part = path.with_suffix(".part")
    try:
        part.write_text(to_metadata_yaml(metadata), encoding="utf-8")
        part.replace(path)
    except OSError as error:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        raise write_error(path, error) from error
