"""A Parquet file that is written in parts, and complete once it has its name."""

from __future__ import annotations

import contextlib
import errno
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["PART_SUFFIX", "ExportError", "ParquetFile", "to_export_error"]

PART_SUFFIX = ".part"
"""Suffix of a file that is not complete."""

_ROWS_PER_GROUP = 1 << 17
_BYTES_PER_GROUP = 1 << 23


class ExportError(EarthmovingError):
    """A bag cannot be exported to the given place."""


class ParquetFile:
    """A file being written.

    Attributes:
        path: the file.
        num_rows: number of rows so far.
    """

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        """
        Args:
            path: the file; its folder is created.
            schema: its columns.

        Raises:
            ExportError: it cannot be written.
        """
        self.path = path
        self.num_rows = 0
        self._schema = schema
        self._pending: list[pa.RecordBatch] = []
        self._pending_rows = self._pending_bytes = 0
        self._part = path.with_suffix(PART_SUFFIX)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = pq.ParquetWriter(self._part, schema, compression="zstd")
        except OSError as error:
            raise to_export_error(path, error) from error

    def add(self, batch: pa.RecordBatch) -> None:
        """Add rows.

        Raises:
            ExportError: the file cannot be written.
        """
        self.num_rows += batch.num_rows
        self._pending.append(batch)
        self._pending_rows += batch.num_rows
        self._pending_bytes += batch.nbytes
        if self._pending_rows >= _ROWS_PER_GROUP or self._pending_bytes >= _BYTES_PER_GROUP:
            self._write()

    def close(self) -> None:
        """Finish the file and give it its name.

        Raises:
            ExportError: it cannot be written.
        """
        self._write()
        try:
            self._writer.close()
            self._part.replace(self.path)
        except OSError as error:
            raise to_export_error(self.path, error) from error

    def discard(self) -> None:
        """Remove the file before it is complete; after `close` this does nothing."""
        with contextlib.suppress(OSError, pa.ArrowException):
            self._writer.close()
        self._part.unlink(missing_ok=True)

    def _write(self) -> None:
        if not self._pending:
            return
        table = pa.Table.from_batches(self._pending, self._schema)
        self._pending, self._pending_rows, self._pending_bytes = [], 0, 0
        try:
            self._writer.write_table(table.combine_chunks(), row_group_size=_ROWS_PER_GROUP)
        except OSError as error:
            raise to_export_error(self.path, error) from error


def to_export_error(path: Path, error: OSError) -> ExportError:
    """Return the error for a file that cannot be written."""
    reason = error.strerror or str(error)
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return ExportError(f"there is no disk space for {path} ({reason}); free some")
    return ExportError(f"{path} cannot be written ({reason}); give another folder")
