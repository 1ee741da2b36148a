"""Export all topics of a bag as Parquet tables, one file each."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from earthmoving_sim.bag_export.message_types import MessageTypes, UnreadableTypeError
from earthmoving_sim.bag_export.output_folder import check_folder, remove_former_export
from earthmoving_sim.bag_export.parquet_file import ExportError
from earthmoving_sim.bag_export.topic_writer import ExportedTopic, TopicWriter
from msg_bridge.bag.reader import BagReader
from msg_bridge.contract import topics

__all__ = ["MAP_CHOICES", "BagExport", "ExportedTopic", "check_export", "export_bag"]

MAP_CHOICES = ("ends", "all", "none")
"""Which terrain maps are exported: the first and the last one of the bag, all, or none."""

_MAP = f"/{topics.TERRAIN_MAP}"
_PROGRESS_INTERVAL = 1000  # messages


@dataclass
class BagExport:
    """The tables of a bag.

    Attributes:
        folder: their folder.
        topics: the exported topics.
        truncated: names of files of the bag without an end.
    """

    folder: Path
    topics: list[ExportedTopic] = field(default_factory=list)
    truncated: tuple[str, ...] = ()

    @property
    def is_complete(self) -> bool:
        """Whether every message of every topic is in a table."""
        return not any(each.reason or each.num_rejected for each in self.topics)


def check_export(
    reader: BagReader,
    folder: Path,
    *,
    is_selected: Callable[[str], bool] = lambda topic: True,
    maps: str = "ends",
    overwrite: bool = False,
) -> None:
    """Check that a bag can be exported, before anything is written.

    Args:
        reader, folder, is_selected, maps, overwrite: as for `export_bag`.

    Raises:
        ExportError: the folder has other files, or no message is to be exported.
    """
    check_folder(folder, overwrite=overwrite)
    if not any(
        reader.topics[name].count and not _is_unwanted_map(name, maps)
        for name in filter(is_selected, reader.topics)
    ):
        raise ExportError(
            f"{reader.path} has no message to export; change --include, --exclude or --maps. Its"
            f" topics are {', '.join(reader.topics)}"
        )


def export_bag(
    reader: BagReader,
    folder: Path,
    *,
    is_selected: Callable[[str], bool] = lambda topic: True,
    maps: str = "ends",
    overwrite: bool = False,
    progress: Callable[[float], None] | None = None,
) -> BagExport:
    """Write a table for each topic of a bag.

    Args:
        reader: the bag.
        folder: folder of the tables, empty or missing; with `overwrite` it may have the tables of
            a former export.
        is_selected: returns whether a topic is exported.
        maps: which terrain maps are exported, one of MAP_CHOICES.
        overwrite: whether a former export is removed.
        progress: is called with the fraction that is done.

    Raises:
        ExportError: the folder has other files or cannot be written, or no message is to be
            exported.
        BagReadError: the bag is damaged.
    """
    check_export(reader, folder, is_selected=is_selected, maps=maps, overwrite=overwrite)
    remove_former_export(folder)
    export = BagExport(folder, truncated=reader.truncated)
    types = MessageTypes(reader)
    writers: dict[str, TopicWriter] = {}
    for name in filter(is_selected, reader.topics):
        info = reader.topics[name]
        result = ExportedTopic(name, info.type, num_messages=info.count)
        export.topics.append(result)
        if not info.count:
            continue
        if _is_unwanted_map(name, maps):
            result.is_wanted = False
            continue
        only_ends = name.endswith(_MAP) and maps == "ends"
        try:
            writers[name] = TopicWriter(reader, types, result, folder, only_ends=only_ends)
        except UnreadableTypeError as error:
            result.reason = str(error)
    _observe(reader, writers)
    _write(reader, writers, progress)
    return export


def _is_unwanted_map(topic: str, maps: str) -> bool:
    return maps == "none" and topic.endswith(_MAP)


def _observe(reader: BagReader, writers: Mapping[str, TopicWriter]) -> None:
    """Find the columns of the tables that depend on the content of all messages."""
    wanted = [name for name, writer in writers.items() if writer.depends_on_content]
    for topic, time, data in reader.raw_messages(wanted):
        writers[topic].observe(time, data)


def _write(
    reader: BagReader,
    writers: Mapping[str, TopicWriter],
    progress: Callable[[float], None] | None,
) -> None:
    total = sum(reader.topics[name].count for name in writers)
    try:
        for number, (topic, time, data) in enumerate(reader.raw_messages(writers)):
            writers[topic].add(time, data)
            if progress is not None and number % _PROGRESS_INTERVAL == 0:
                progress(number / max(total, 1))
        for writer in writers.values():
            writer.close()
    finally:
        for writer in writers.values():
            writer.discard()
    if progress is not None:
        progress(1.0)
