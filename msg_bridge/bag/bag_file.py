"""One MCAP file of a bag being written, with all topics of the bag."""

from __future__ import annotations

from pathlib import Path

from mcap.records import Message

from msg_bridge.bag.atomic_file import AtomicFile
from msg_bridge.bag.mcap_file import McapFileWriter
from msg_bridge.bag.message_schemas import schema_text
from msg_bridge.bag.metadata import FileMetadata, TopicMetadata, to_qos_yaml

__all__ = ["BagFile"]

_SEQUENCE_MODULUS = 2**32


class BagFile:
    """A file being written.

    Attributes:
        path: the file.
        messages: number of its messages, those of the current chunk included.
        first, last: log times of its first and last message [ns]; None without messages.
    """

    def __init__(self, path: Path, *, compression: str, chunk_size: int) -> None:
        """Create the file.

        Args:
            path: the file, which does not exist.
            compression: of chunks, as the library `mcap` names it.
            chunk_size: [bytes] before compression.

        Raises:
            BagError: it cannot be written.
        """
        self.path = path
        self.messages = 0
        self.first: int | None = None
        self.last: int | None = None
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._stream = AtomicFile(path)
        self._mcap = McapFileWriter(
            self._stream,
            profile="ros2",
            library="earthmoving_sim",
            compression=compression,
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
    def closed(self) -> bool:
        """Whether the file is closed."""
        return self._stream.closed

    @property
    def metadata(self) -> FileMetadata:
        """Its entry in metadata.yaml."""
        return FileMetadata(self.path.name, self.first, self.last, self.messages)

    def add_topic(self, topic: TopicMetadata) -> None:
        """Add a topic.

        Raises:
            SchemaError: its type is not installed.
        """
        if topic.type_name not in self._schemas:
            text = schema_text(topic.type_name).encode()
            self._schemas[topic.type_name] = self._mcap.add_schema(topic.type_name, "ros2msg", text)
        metadata = {
            "offered_qos_profiles": to_qos_yaml(topic.offered),
            "topic_type_hash": topic.type_hash,
        }
        schema = self._schemas[topic.type_name]
        self._channels[topic.name] = self._mcap.add_channel(topic.name, schema, metadata)

    def write(
        self, topic: str, data: bytes, log_time: int, publish_time: int, sequence: int
    ) -> None:
        """Add a message; arguments and errors are those of `BagWriter.write`."""
        channel = self._channels[topic]
        self._mcap.add_message(
            Message(channel, log_time, data, publish_time, sequence % _SEQUENCE_MODULUS)
        )
        self.messages += 1
        self.first = log_time if self.first is None else min(self.first, log_time)
        self.last = log_time if self.last is None else max(self.last, log_time)

    def attach(self, name: str, media_type: str, data: bytes, time: int) -> None:
        """Add a file as an attachment; arguments and errors are those of `BagWriter.attach`."""
        self._mcap.add_attachment(name, media_type, data, time)

    def flush(self) -> None:
        """Write the current chunk to the file.

        Raises:
            BagError: it cannot be written.
        """
        self._mcap.write_chunk()

    def close(self) -> None:
        """Write the index and close the file; after a failed write it is only closed.

        Raises:
            BagError: the index cannot be written.
        """
        try:
            if not self._stream.has_failed:
                self._mcap.finish()
        finally:
            self._stream.close()
