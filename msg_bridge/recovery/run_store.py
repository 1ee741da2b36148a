"""The journal of a run in SQLite: how it began, and the inputs of each of its ticks.

Records are in segments, databases of their own: a segment that no checkpoint needs any more is
deleted as a file. They are committed to the write-ahead log of their database without waiting for
the disk: they survive the death of the process at any moment, and not a power failure. A database
that a power failure damaged is found by SQLite, or by the checksum of a record.
"""

from __future__ import annotations

import contextlib
import fcntl
import itertools
import sqlite3
import uuid
import zlib
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

from msg_bridge.recovery.errors import RecoveryError

__all__ = ["RunStore", "StoredRun"]

_RUN = "run.sqlite"
_RUN_TABLE = "create table run (run_key text not null, begin blob not null, num_before integer)"

_PART = "part.sqlite"

_SEGMENTS = "inputs_*.sqlite"
_RECORD_TABLE = """
create table records (
    number integer primary key, checksum integer not null, content blob not null
)
"""
_INSERT = "insert into records values (?, ?, ?)"


class StoredRun(NamedTuple):
    """The run in a store.

    Attributes:
        run_key: unique name of the run; checkpoints of other runs are not its own.
        begin: what `begin_run` was given.
        num_before: number of the records before the first one that was to be stored.
    """

    run_key: str
    begin: bytes
    num_before: int


class RunStore:
    """The databases of one node, which one process uses at a time.

    Attributes:
        folder: their folder.
        run_key: unique name of the run that is stored; empty without one.
    """

    def __init__(self, folder: Path) -> None:
        """
        Args:
            folder: folder of the databases; it is made if it does not exist.

        Raises:
            RecoveryError: it cannot be written, or another process uses it.
        """
        self.folder, self.run_key = folder, ""
        self._segment: sqlite3.Connection | None = None
        self._ended_segments: list[sqlite3.Connection] = []
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
        path = self.folder / _RUN
        if not path.exists():
            return None
        with _reading(path), closing(sqlite3.connect(path)) as connection:
            row = connection.execute("select run_key, begin, num_before from run").fetchone()
        if row is None:
            return None
        self.run_key = row[0]
        return StoredRun(*row)

    def last_record(self, after: int) -> int:
        """Return the number of the last record.

        Args:
            after: number of a record; those after it must be there without a gap.

        Raises:
            RecoveryError: they are not, or a database is damaged.
        """
        last = after
        query = "select count(*), min(number), max(number) from records where number > ?"
        for path in self._segment_paths():
            with _reading(path), closing(sqlite3.connect(path)) as connection:
                count, first, newest = connection.execute(query, (after,)).fetchone()
            if count == 0:
                continue
            if first != last + 1 or count != newest - last:
                raise RecoveryError(f"{self.folder} lacks inputs between {last} and {newest}")
            last = newest
        return last

    def records(self, after: int) -> Iterator[bytes]:
        """Return the records after the one with a number, in order.

        Raises:
            RecoveryError: one is damaged.
        """
        query = "select number, checksum, content from records where number > ? order by number"
        for path in self._segment_paths():
            with _reading(path), closing(sqlite3.connect(path)) as connection:
                for number, checksum, content in connection.execute(query, (after,)):
                    if zlib.crc32(content) != checksum:
                        raise RecoveryError(f"record {number} of {path} is damaged")
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
        with self._new_database(self.folder / _RUN) as connection:
            connection.execute(_RUN_TABLE)
            connection.execute("insert into run values (?, ?, ?)", (run_key, begin, num_before))
        self.run_key = run_key
        self.start_segment(num_before)

    def start_segment(self, number: int) -> None:
        """Begin another segment; the one before is closed by `close_ended_segments`.

        Args:
            number: number of the last record before it.

        Raises:
            sqlite3.Error, OSError: it cannot be written.
        """
        if self._segment is not None:
            self._ended_segments.append(self._segment)
            self._segment = None
        path = self.folder / _SEGMENTS.replace("*", f"{number + 1:012d}")
        with self._new_database(path) as connection:
            connection.execute(_RECORD_TABLE)
        segment = self._segment = sqlite3.connect(
            path, isolation_level=None, check_same_thread=False
        )
        # Without the locks of shared access a commit takes less time.
        segment.execute("pragma locking_mode = exclusive")
        segment.execute("pragma journal_mode = wal")
        segment.execute("pragma synchronous = off")
        segment.execute("pragma wal_autocheckpoint = 0")

    def close_ended_segments(self) -> None:
        """Close the segments before the present one, in any thread: it takes some milliseconds."""
        while self._ended_segments:
            with contextlib.suppress(sqlite3.Error):  # as on a full disk
                self._ended_segments.pop().close()

    def append(self, number: int, content: bytes) -> None:
        """Store a record in the present segment.

        Args:
            number: its number, one more than that of the record before.
            content: the record.

        Raises:
            sqlite3.Error: it cannot be written.
        """
        assert self._segment is not None, "a segment was begun"
        self._segment.execute(_INSERT, (number, zlib.crc32(content), content))

    def discard_through(self, number: int) -> None:
        """Delete the segments with records up to a number only; not the last one.

        Raises:
            OSError: one cannot be deleted.
        """
        paths = self._segment_paths()
        for path, following in itertools.pairwise(paths):
            if _first_record(following) <= number + 1:
                _delete_database(path)

    def end_run(self) -> None:
        """Delete the run: there is nothing to continue.

        Raises:
            OSError: it cannot be deleted.
        """
        self._close_segment()
        self.run_key = ""
        for path in (self.folder / _RUN, *self._segment_paths()):
            _delete_database(path)

    def close(self) -> None:
        """Close the databases, and let other processes use them."""
        self._close_segment()
        self._lock.close()

    @contextlib.contextmanager
    def _new_database(self, path: Path) -> Iterator[sqlite3.Connection]:
        """Yield a connection to a database that has its name once its content is complete: the
        process may die at any moment."""
        part = self.folder / _PART
        _delete_database(part)
        with closing(sqlite3.connect(part)) as connection:
            connection.execute("pragma synchronous = off")
            yield connection
            connection.commit()
        part.replace(path)

    def _segment_paths(self) -> list[Path]:
        return sorted(self.folder.glob(_SEGMENTS))

    def _close_segment(self) -> None:
        if self._segment is not None:
            self._ended_segments.append(self._segment)
            self._segment = None
        self.close_ended_segments()


def _first_record(segment: Path) -> int:
    """Return the number of the first record of a segment, from its name."""
    return int(segment.stem.rpartition("_")[2])


def _delete_database(path: Path) -> None:
    for suffix in ("-wal", "-shm", "-journal", ""):
        path.with_name(path.name + suffix).unlink(missing_ok=True)


@contextlib.contextmanager
def _reading(path: Path) -> Iterator[None]:
    try:
        yield
    except sqlite3.Error as error:
        raise RecoveryError(f"{path} is damaged ({error})") from error
