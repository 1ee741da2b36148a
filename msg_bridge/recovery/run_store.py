"""The journal of a run: how it began, and the inputs of each of its ticks, in SQLite.

Records are committed to the write-ahead log of the database without waiting for the disk: they
survive the death of the process at any moment, and not a power failure. A database that a power
failure damaged is found by SQLite, or by the checksum of a record.
"""

from __future__ import annotations

import contextlib
import fcntl
import sqlite3
import uuid
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from msg_bridge.recovery.errors import RecoveryError

__all__ = ["RunStore", "StoredRun"]

_NAME = "journal.sqlite"

_TABLES = """
create table run (id text not null, begin blob not null, num_before integer not null);
create table records (number integer primary key, checksum integer not null, content blob not null);
"""

_DISCARDED_PER_RECORD = 2
"""Maximum number of old records that are deleted with each new one, so that none takes long."""


class StoredRun(NamedTuple):
    """The run in a store.

    Attributes:
        run_key: unique name of the run; checkpoints of other runs are not its own.
        begin: what `begin_run` was given.
        num_before: number of the records before the first one that is stored.
    """

    run_key: str
    begin: bytes
    num_before: int


class RunStore:
    """The database of one node, which one process uses at a time.

    Attributes:
        folder: its folder.
        run_key: unique name of the run that is stored; empty without one.
    """

    def __init__(self, folder: Path) -> None:
        """
        Args:
            folder: folder of the database; it is made if it does not exist.

        Raises:
            RecoveryError: it cannot be written, or another process uses it.
        """
        self.folder, self.run_key = folder, ""
        self._path = folder / _NAME
        self._connection: sqlite3.Connection | None = None
        self._discard_through = 0
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._lock = (folder / "lock").open("a")
        except OSError as error:
            raise RecoveryError(
                f"recovery.path: {folder} cannot be written ({error}); give another folder"
            ) from error
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._lock.close()
            raise RecoveryError(
                f"recovery.path: {folder} is used by another process; end it, or give this node"
                " another folder"
            ) from error

    def stored_run(self) -> StoredRun | None:
        """Return the run that is stored, None without one.

        Raises:
            RecoveryError: the database is damaged.
        """
        if not self._path.exists():
            return None
        with self._reading():
            row = self._open().execute("select id, begin, num_before from run").fetchone()
        if row is None:
            return None
        self.run_key = row[0]
        return StoredRun(*row)

    def last_record(self, after: int) -> int:
        """Return the number of the last record.

        Args:
            after: number of a record; those after it must be there without a gap.

        Raises:
            RecoveryError: they are not, or the database is damaged.
        """
        with self._reading():
            query = "select count(*), max(number) from records where number > ?"
            count, last = self._open().execute(query, (after,)).fetchone()
        if count == 0:
            return after
        if count != last - after:
            raise RecoveryError(f"{self._path} lacks inputs between records {after} and {last}")
        return int(last)

    def records(self, after: int) -> Iterator[bytes]:
        """Return the records after the one with a number, in order.

        Raises:
            RecoveryError: one is damaged.
        """
        query = "select number, checksum, content from records where number > ? order by number"
        with self._reading():
            for number, checksum, content in self._open().execute(query, (after,)):
                if zlib.crc32(content) != checksum:
                    raise RecoveryError(f"record {number} of {self._path} is damaged")
                yield content

    def begin_run(self, begin: bytes, num_before: int = 0) -> None:
        """Store the begin of a run; what was stored before is deleted.

        Args:
            begin: what the run begins with.
            num_before: number of the records that will not be stored.

        Raises:
            sqlite3.Error, OSError: it cannot be written.
        """
        self.end_run()
        run_key = uuid.uuid4().hex
        connection = self._open()
        connection.executescript(f"begin; {_TABLES} commit;")
        connection.execute("insert into run values (?, ?, ?)", (run_key, begin, num_before))
        self.run_key = run_key

    def append(self, number: int, content: bytes) -> None:
        """Store a record.

        Args:
            number: its number, one more than that of the record before.
            content: the record.

        Raises:
            sqlite3.Error: it cannot be written.
        """
        connection = self._open()
        connection.execute(
            "insert into records values (?, ?, ?)", (number, zlib.crc32(content), content)
        )
        if self._discard_through:
            deleted = connection.execute(
                "delete from records where number in (select number from records where number <= ?"
                " order by number limit ?)",
                (self._discard_through, _DISCARDED_PER_RECORD),
            )
            if deleted.rowcount < _DISCARDED_PER_RECORD:
                self._discard_through = 0

    def discard_through(self, number: int) -> None:
        """Delete the records up to a number, some with each record that is appended."""
        self._discard_through = number

    def end_run(self) -> None:
        """Delete the run: there is nothing to continue.

        Raises:
            OSError: it cannot be deleted.
        """
        self._close_database()
        self.run_key, self._discard_through = "", 0
        for suffix in ("-wal", "-shm", ""):
            self._path.with_name(_NAME + suffix).unlink(missing_ok=True)

    def close(self) -> None:
        """Close the database, and let other processes use it."""
        self._close_database()
        self._lock.close()

    def _open(self) -> sqlite3.Connection:
        if self._connection is None:
            self._connection = sqlite3.connect(self._path, isolation_level=None)
            self._connection.execute("pragma journal_mode = wal")
            self._connection.execute("pragma synchronous = off")
        return self._connection

    def _close_database(self) -> None:
        if self._connection is not None:
            with contextlib.suppress(sqlite3.Error):  # as on a full disk
                self._connection.close()
            self._connection = None

    @contextlib.contextmanager
    def _reading(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as error:
            raise RecoveryError(f"{self._path} is damaged ({error})") from error
