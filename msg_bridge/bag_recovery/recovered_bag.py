"""Write what can be read of a bag as another bag."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml
import zstandard
from mcap.records import Attachment, Channel, Message, Schema

from msg_bridge.bag.atomic_file import AtomicFile
from msg_bridge.bag.bag_files import bag_files_in
from msg_bridge.bag.compressed_message import decompress_message, is_compressed_message
from msg_bridge.bag.mcap_file import McapFileWriter
from msg_bridge.bag.mcap_index import BagReadError
from msg_bridge.bag.metadata import BagMetadata, FileMetadata, TopicMetadata, from_qos_yaml
from msg_bridge.bag.writer import CHUNK_SIZE, COMPRESSIONS, write_metadata
from msg_bridge.bag_recovery.output_folder import OutputFolder
from msg_bridge.bag_recovery.salvage import Damage, SalvagedFile
from msg_bridge.count_text import count_text
from msg_bridge.yaml_text import load_yaml

__all__ = ["RecoveredBag", "RecoveredFile", "recover_bag"]

_PROGRESS_STEP = 0.01


@dataclass
class RecoveredFile:
    """What was read of a file.

    Attributes:
        path: the file.
        messages: number of its messages, with those of a chunk in which the file ends.
        num_cut_off: number of messages from such a chunk.
        num_without_channel: number of messages left out because their channel is lost.
        num_compressed: number of messages that were compressed one by one.
        num_undecompressed: number of messages left out because they cannot be decompressed.
        is_complete: whether the file has its end.
        is_compressed: whether the file was compressed as a whole.
        damages: parts that could not be read.
    """

    path: Path
    messages: int = 0
    num_cut_off: int = 0
    num_without_channel: int = 0
    num_compressed: int = 0
    num_undecompressed: int = 0
    is_complete: bool = False
    is_compressed: bool = False
    damages: list[Damage] = field(default_factory=list)

    @property
    def is_intact(self) -> bool:
        """Whether the file is complete and undamaged, and can be read as it is."""
        is_compressed = self.is_compressed or self.num_compressed > 0
        return self.is_complete and not (is_compressed or self.damages or self.has_losses)

    @property
    def has_losses(self) -> bool:
        """Whether anything is lost but an end that was not written."""
        num_left_out = self.num_without_channel + self.num_undecompressed
        return num_left_out > 0 or any(each.is_loss for each in self.damages)


@dataclass
class RecoveredBag:
    """What was read of a bag.

    Attributes:
        files: its files.
        folder: folder of the new bag; it is not written if the bag is intact.
        had_metadata: whether the bag had a readable metadata.yaml.
        missing: names of the files that metadata.yaml names and that are not there.
        is_renamed: whether there are as many other files in place of the missing ones.
    """

    files: list[RecoveredFile]
    folder: Path
    had_metadata: bool
    missing: tuple[str, ...] = ()
    is_renamed: bool = False

    @property
    def messages(self) -> int:
        """Number of messages."""
        return sum(each.messages for each in self.files)

    @property
    def is_intact(self) -> bool:
        """Whether the bag was complete and undamaged, and can be read as it is."""
        are_files_intact = all(each.is_intact for each in self.files)
        return self.had_metadata and not self.missing and are_files_intact

    @property
    def has_losses(self) -> bool:
        """Whether anything is lost but an end that was not written."""
        return bool(self.missing and not self.is_renamed) or any(
            each.has_losses for each in self.files
        )


def recover_bag(
    path: Path,
    folder: Path,
    *,
    compression: str = "zstd",
    progress: Callable[[float], None] | None = None,
) -> RecoveredBag:
    """Write what can be read of a bag as another bag, unless it is complete and undamaged.

    If nothing is written, the folder and its parents are as they were before.

    Args:
        path: folder of the bag, or one file.
        folder: folder of the new bag, empty or missing.
        compression: of its chunks, one of `msg_bridge.bag.writer.COMPRESSIONS`.
        progress: is called with the fraction that has been read.

    Raises:
        BagReadError: there are no MCAP files, or none has messages.
        BagError: the new bag cannot be written.
    """
    sources = _files_of(path)
    custom, named = _read_metadata(path)
    output = OutputFolder(folder)
    try:
        topics: dict[str, TopicMetadata] = {}
        recovered, written = _recover_files(sources, folder, topics, compression, progress)
        missing = () if path.is_file() else _missing_files(path, named)
        num_others = sum(each.name not in named for each in sources)
        bag = RecoveredBag(
            recovered, folder, custom is not None, missing, len(missing) <= num_others
        )
        if not bag.messages:
            raise BagReadError(f"{path} has no message that can be read: {_describe(recovered)}")
        if not bag.is_intact:
            summary = {**(custom or {}), "recovered": _summary(bag)}
            write_metadata(folder, BagMetadata(tuple(written), tuple(topics.values()), summary))
    except BaseException:  # a part of a bag is no bag, and another attempt needs its place
        output.remove()
        raise
    if bag.is_intact:
        output.remove()
    return bag


def _describe(files: Sequence[RecoveredFile]) -> str:
    """Return what is in place of messages in files without any."""
    texts = []
    for file in files:
        parts = [part.text for part in file.damages]
        if file.num_undecompressed:
            parts.append(f"{count_text(file.num_undecompressed, 'message')} cannot be decompressed")
        if file.num_without_channel:
            parts.append(f"the topic of {count_text(file.num_without_channel, 'message')} is lost")
        size = file.path.stat().st_size
        texts.append(f"{file.path.name} ({size:,} bytes): {'; '.join(parts) or 'no messages'}")
    return "; ".join(texts)


def _missing_files(folder: Path, named: set[str]) -> tuple[str, ...]:
    """Return which of the named files are missing, compressed or not."""
    return tuple(sorted(name for name in named if not (folder / name).is_file()))


def _recover_files(
    sources: Sequence[Path],
    folder: Path,
    topics: dict[str, TopicMetadata],
    compression: str,
    progress: Callable[[float], None] | None,
) -> tuple[list[RecoveredFile], list[FileMetadata]]:
    """Write what can be read of the files of a bag; return what was read, and the new files.

    Args:
        sources: the files.
        folder, compression, progress: as of `recover_bag`.
        topics: topics of the bag with their numbers of messages, which are added.

    Raises:
        BagReadError: the only file cannot be read.
        BagError: the new bag cannot be written.
    """
    recovered: list[RecoveredFile] = []
    written: list[FileMetadata] = []
    for number, source in enumerate(sources):
        file = folder / f"{folder.resolve().name}_{len(written)}.mcap"
        writer = _FileWriter(file, COMPRESSIONS[compression], topics)
        salvaged = SalvagedFile(source, folder)
        reported, is_readable = 0.0, True
        try:
            for record, fraction in salvaged.records():
                writer.add(record)
                if progress is not None and fraction - reported >= _PROGRESS_STEP:
                    reported = fraction
                    progress((number + fraction) / len(sources))
        except BagReadError as error:
            if len(sources) == 1:
                raise
            is_readable = False
            salvaged.damages.append(_unreadable(source, str(error)))
        finally:
            entry = writer.close()
        if is_readable:
            written.append(entry)
        else:
            file.unlink()
        recovered.append(
            RecoveredFile(
                source,
                writer.messages,
                salvaged.num_cut_off,
                writer.num_without_channel,
                writer.num_compressed,
                writer.num_undecompressed,
                salvaged.is_complete,
                salvaged.is_compressed,
                salvaged.damages,
            )
        )
    if progress is not None:
        progress(1.0)
    return recovered, written


def _unreadable(file: Path, text: str) -> Damage:
    """Return the damage of a whole file; an empty one is an end that was never written."""
    size = file.stat().st_size if file.exists() else None
    return Damage(0, size or 0, text, is_loss=size != 0)


class _FileWriter:
    """A file of the new bag.

    Attributes:
        messages: number of its messages.
        num_without_channel: number of messages left out because their channel is unknown.
        num_compressed: number of messages that were compressed one by one.
        num_undecompressed: number of messages left out because they cannot be decompressed.
    """

    def __init__(self, path: Path, compression: str, topics: dict[str, TopicMetadata]) -> None:
        """
        Args:
            path: the file.
            compression: of its chunks, as the library `mcap` names it.
            topics: topics of the bag with their numbers of messages, which are updated.
        """
        self.messages = self.num_without_channel = 0
        self.num_compressed = self.num_undecompressed = 0
        self._first: int | None = None
        self._last: int | None = None
        self._path, self._topics = path, topics
        self._stream = AtomicFile(path)
        self._mcap = McapFileWriter(
            self._stream,
            profile="ros2",
            library="earthmoving_sim",
            compression=compression,
            chunk_size=CHUNK_SIZE,
        )
        self._schemas: dict[int, Schema] = {}
        self._new_schemas: dict[int, int] = {0: 0}  # id in the new file by that in the old one
        self._channels: dict[int, Channel] = {}
        self._new_channels: dict[int, int] = {}
        self._pending: list[Message] = []  # until the summary has their channels

    def add(self, record: Schema | Channel | Message | Attachment) -> None:
        """Write a record.

        Raises:
            BagError: it cannot be written.
        """
        if isinstance(record, Schema):
            self._schemas.setdefault(record.id, record)
        elif isinstance(record, Channel):
            if record.id not in self._channels:
                self._channels[record.id] = record
                self._write_pending()
        elif isinstance(record, Attachment):
            self._mcap.add_attachment(
                record.name, record.media_type, record.data, record.create_time
            )
        elif record.channel_id not in self._channels:
            self._pending.append(record)
        else:
            self._write(record)

    def close(self) -> FileMetadata:
        """Finish the file; return its entry in metadata.yaml."""
        self.num_without_channel = len(self._pending)
        try:
            if not self._stream.has_failed:
                self._mcap.finish()
        finally:
            self._stream.close()
        return FileMetadata(self._path.name, self._first, self._last, self.messages)

    def _write_pending(self) -> None:
        pending, self._pending = self._pending, []
        for message in pending:
            self.add(message)

    def _write(self, message: Message) -> None:
        channel = self._channels[message.channel_id]
        if channel.message_encoding == "cdr" and is_compressed_message(message.data):
            try:
                message = replace(message, data=decompress_message(message.data))
            except zstandard.ZstdError:
                self.num_undecompressed += 1
                return
            self.num_compressed += 1
        if channel.id not in self._new_channels:
            self._add_channel(channel)
        self._mcap.add_message(replace(message, channel_id=self._new_channels[channel.id]))
        self.messages += 1
        time = message.log_time
        self._first = time if self._first is None else min(self._first, time)
        self._last = time if self._last is None else max(self._last, time)
        topic = self._topics.get(channel.topic)
        if topic is not None:
            self._topics[channel.topic] = replace(topic, count=topic.count + 1)

    def _add_channel(self, channel: Channel) -> None:
        schema = self._schemas.get(channel.schema_id)
        if schema is not None and schema.id not in self._new_schemas:
            self._new_schemas[schema.id] = self._mcap.add_schema(
                schema.name, schema.encoding, schema.data
            )
        self._new_channels[channel.id] = self._mcap.add_channel(
            channel.topic,
            self._new_schemas.get(channel.schema_id, 0),
            channel.metadata,
            channel.message_encoding,
        )
        if channel.message_encoding == "cdr" and schema is not None:
            self._topics.setdefault(channel.topic, _topic_metadata(channel, schema))


def _topic_metadata(channel: Channel, schema: Schema) -> TopicMetadata:
    """Return the entry of a topic in metadata.yaml, without messages."""
    offered = from_qos_yaml(channel.metadata.get("offered_qos_profiles", ""))
    type_hash = channel.metadata.get("topic_type_hash", "")
    return TopicMetadata(channel.topic, schema.name, type_hash, offered, 0)


def _files_of(path: Path) -> list[Path]:
    """Return the MCAP files of a bag, without use of its metadata.yaml.

    Raises:
        BagReadError: there are none.
    """
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise BagReadError(f"there is no bag {path}; give a folder of .mcap files, or one of them")
    files = bag_files_in(path)
    if not files:
        raise BagReadError(f"{path} has no .mcap file; bags in other formats cannot be recovered")
    return files


def _read_metadata(path: Path) -> tuple[Mapping[str, str] | None, set[str]]:
    """Return custom data and names of the files of the bag's metadata.yaml.

    The first is None, and there are no names, if there is no readable one.
    """
    folder = path if path.is_dir() else path.parent
    try:
        content: Any = load_yaml((folder / "metadata.yaml").read_text(encoding="utf-8"))
        information = content["rosbag2_bagfile_information"]
        custom = information.get("custom_data") or {}
        names = {str(name) for name in information.get("relative_file_paths") or ()}
        return {str(name): str(value) for name, value in custom.items()}, names
    except (OSError, UnicodeDecodeError, yaml.YAMLError, KeyError, TypeError, AttributeError):
        return None, set()


def _summary(bag: RecoveredBag) -> str:
    """Return what was lost, as custom data of metadata.yaml (JSON)."""
    return json.dumps(
        {
            each.path.name: {
                "had_end": each.is_complete,
                "damages": [
                    {"offset": part.offset, "bytes": part.length, "text": part.text}
                    for part in each.damages
                ],
            }
            for each in bag.files
        }
        | {name: {"missing": True} for name in bag.missing}
    )
