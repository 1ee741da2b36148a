"""Write the messages of one topic as a table."""

from __future__ import annotations

import json
from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from earthmoving_sim.bag_export.cloud_tables import CloudTable
from earthmoving_sim.bag_export.columns import LOG_TIME, with_free_names
from earthmoving_sim.bag_export.message_types import MessageTypes
from earthmoving_sim.bag_export.parquet_file import ParquetFile
from earthmoving_sim.bag_export.tables import (
    ArrayTable,
    JointTable,
    JsonTable,
    MessageTable,
    StatusTable,
    Table,
)
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec.run_config import versions

__all__ = ["ExportedTopic", "TopicWriter"]

_CLOUD = "sensor_msgs/msg/PointCloud2"
_JOINTS = "sensor_msgs/msg/JointState"
_DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
_INTEGERS, _FLOATS = "std_msgs/msg/Int64MultiArray", "std_msgs/msg/Float64MultiArray"
_TEXT = "std_msgs/msg/String"

_MAX_ROWS, _MAX_BYTES = 8192, 1 << 22
"""Numbers of rows, and of bytes of messages, that are collected before they become Arrow arrays."""


@dataclass
class ExportedTopic:
    """A topic of an exported bag.

    Attributes:
        topic, type: its name and message type.
        file: the table; None without one.
        num_rows: number of its rows.
        num_messages: number of messages in the bag.
        num_rejected: number of messages that have no place in the table, or cannot be decoded.
        is_wanted: whether it is exported.
        reason: why there is no table although there are messages; empty if there is one.
    """

    topic: str
    type: str
    file: Path | None = None
    num_rows: int = 0
    num_messages: int = 0
    num_rejected: int = 0
    is_wanted: bool = True
    reason: str = ""


class TopicWriter:
    """The table of a topic being written.

    Attributes:
        depends_on_content: whether `observe` is to be called with all messages before `add`.
    """

    def __init__(
        self,
        reader: BagReader,
        types: MessageTypes,
        result: ExportedTopic,
        folder: Path,
        *,
        only_ends: bool,
    ) -> None:
        """
        Args:
            reader: the bag.
            types: its message types.
            result: the topic; it is updated.
            folder: folder of the tables.
            only_ends: whether only the first and the last message are exported.

        Raises:
            UnreadableTypeError: the definition of the message type is missing or not usable.
        """
        self._reader, self._result, self._only_ends = reader, result, only_ends
        self._path = folder / f"{result.topic.strip('/')}.parquet"
        self._decode = types.decoder(result.topic)
        self._is_transient_local = any(
            each.durability == "transient_local" for each in reader.offered_qos(result.topic)
        )
        self._generic = MessageTable(types, result.type)
        self._observed = _observing_table(result.type)
        self._has_content = self._observed is not None
        self._cloud: CloudTable | None = None
        self._times: list[int] = []  # log time of each pending row [ns]
        self._columns: dict[str, list[Any]] = defaultdict(list)
        self._num_pending = self._num_pending_bytes = 0
        self._previous = b""
        self._last: tuple[int, bytes] | None = None  # with only_ends
        self._file: ParquetFile | None = None

    @property
    def depends_on_content(self) -> bool:
        """Whether columns depend on what is in the messages."""
        return self._observed is not None

    def observe(self, time: int, data: bytes) -> None:
        """Find the columns of a message.

        Args:
            time: log time [ns].
            data: CDR bytes.
        """
        if not self._has_content or self._observed is None:
            return
        message = self._decoded(data, time)
        if message is not None and not self._observed.observe(message):
            self._has_content = False  # one table for all: as any message

    def add(self, time: int, data: bytes) -> None:
        """Add a message; arguments are those of `observe`.

        Raises:
            ExportError: the table cannot be written.
        """
        if self._is_transient_local and data == self._previous:
            return  # repeated by the recorder
        is_first, self._previous = not self._previous, data
        if self._only_ends and not is_first:
            self._last = (time, data)
            return
        self._add(time, data)

    def close(self) -> None:
        """Write the rest and finish the table.

        Raises:
            ExportError: it cannot be written.
        """
        if self._last is not None:
            self._add(*self._last)
        self._flush()
        if self._file is None:
            self._result.reason = "no message can be decoded"
            return
        self._file.close()
        self._result.file, self._result.num_rows = self._path, self._file.num_rows

    def discard(self) -> None:
        """Remove a table that is not finished."""
        if self._file is not None:
            self._file.discard()

    def _add(self, time: int, data: bytes) -> None:
        message = self._decoded(data, time)
        is_added = message is not None and (
            self._add_cloud(time, message)
            if self._result.type == _CLOUD
            else self._add_rows(time, message)
        )
        if not is_added:
            self._result.num_rejected += 1
            return
        self._num_pending_bytes += len(data)
        if self._num_pending >= _MAX_ROWS or self._num_pending_bytes >= _MAX_BYTES:
            self._flush()

    def _add_cloud(self, time: int, message: Any) -> bool:
        try:
            self._cloud = self._cloud or CloudTable(message)
        except (KeyError, ValueError, TypeError):  # datatypes or offsets that do not exist
            return False
        is_added = self._cloud.add(time, message)
        self._num_pending = self._cloud.num_pending
        return is_added

    def _add_rows(self, time: int, message: Any) -> bool:
        values = self._table.rows(message)
        if values is None:
            return False
        count = len(next(iter(values.values()))) if values else 0
        self._times += count * [time]
        for name, column in values.items():
            self._columns[name] += column
        self._num_pending += count
        return True

    @property
    def _table(self) -> Table:
        if self._result.type == _JOINTS:
            return JointTable()
        if self._result.type == _DIAGNOSTICS:
            return StatusTable()
        if self._observed is not None and self._has_content and self._observed.fields:
            return self._observed
        return self._generic

    def _flush(self) -> None:
        if self._cloud is not None:
            if not self._cloud.has_pending:
                return
            batch = self._cloud.take()
        elif self._columns:
            fields = self._table.fields
            arrays = [pa.array(self._times, LOG_TIME.type)]
            arrays += [pa.array(self._columns[each.name], each.type) for each in fields]
            schema = pa.schema([LOG_TIME, *with_free_names(fields, [LOG_TIME.name])])
            batch = pa.RecordBatch.from_arrays(arrays, schema=schema)
            self._times.clear()
            self._columns.clear()
        else:
            return
        self._num_pending = self._num_pending_bytes = 0
        if self._file is None:
            self._file = ParquetFile(self._path, batch.schema.with_metadata(self._metadata()))
        self._file.add(batch)

    def _decoded(self, data: bytes, time: int) -> Any:
        """Return the message; None if it cannot be decoded."""
        try:
            return self._decode(data, time)
        except Exception:  # of rosbags, rclpy or the codec, depending on the damage
            return None

    def _metadata(self) -> dict[str, str]:
        return {
            "bag": str(self._reader.path),
            "topic": self._result.topic,
            "type": self._result.type,
            "software": f"earthmoving_sim {versions()['earthmoving_sim']}",
            "truncated_files": json.dumps(self._reader.truncated),
        }


def _observing_table(type_name: str) -> ArrayTable | JsonTable | None:
    """Return the table of a type whose columns depend on the content of the messages."""
    if type_name in (_INTEGERS, _FLOATS):
        return ArrayTable(is_integer=type_name == _INTEGERS)
    return JsonTable() if type_name == _TEXT else None
