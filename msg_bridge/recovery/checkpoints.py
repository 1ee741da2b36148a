"""Checkpoints of a run in SQLite: the newest ones, each with version and checksum.

Another thread compresses and writes them, in a transaction: a checkpoint is there or it is not.
"""

from __future__ import annotations

import hashlib
import json
import pickle
import sqlite3
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import zstandard

from msg_bridge.checkpoint.state_pickle import CapturedState, load_state
from msg_bridge.codec.run_config import versions
from msg_bridge.recovery.errors import RecoveryError

__all__ = ["Checkpoint", "CheckpointWriter", "read_checkpoints"]

_NAME = "checkpoints.sqlite"
_FORMAT = 3

_NUM_KEPT = 2
"""Number of checkpoints that are kept: if the newest is damaged, the one before it is used."""

_TABLE = """
create table if not exists checkpoints (
    run_key text, number integer, format integer, versions text, sha256 text, content blob,
    primary key (run_key, number)
)
"""


class Checkpoint(NamedTuple):
    """A checkpoint as stored.

    Attributes:
        number: number of the last record that it contains.
        format, versions, sha256: format, software and SHA-256 of the content.
        content: the state, see `load_state`.
    """

    number: int
    format: int
    versions: str
    sha256: str
    content: bytes

    def load(self) -> Any:
        """Return the state.

        Raises:
            RecoveryError: it is damaged, or of another version.
        """
        if self.format != _FORMAT or self.versions != _versions():
            raise RecoveryError(f"it was written by {self.versions}, and this is {_versions()}")
        if hashlib.sha256(self.content).hexdigest() != self.sha256:
            raise RecoveryError("its checksum is wrong: it is truncated or damaged")
        try:
            return load_state(self.content)
        except (
            zstandard.ZstdError,
            EOFError,
            pickle.UnpicklingError,
            AttributeError,
            ImportError,
            TypeError,
        ) as error:
            raise RecoveryError(f"it was written by other code of the version ({error})") from error


def read_checkpoints(folder: Path, run_key: str) -> Iterator[Checkpoint]:
    """Yield the checkpoints of a run, the newest first.

    Args:
        folder: folder of the database.
        run_key: unique name of the run.

    Raises:
        RecoveryError: the database is damaged.
    """
    path = folder / _NAME
    if not path.exists():
        return
    query = (
        "select number, format, versions, sha256, content from checkpoints where run_key = ?"
        " order by number desc"
    )
    try:
        with closing(sqlite3.connect(path)) as connection:
            for row in connection.execute(query, (run_key,)):
                yield Checkpoint(*row)
    except sqlite3.Error as error:
        raise RecoveryError(f"{path} is damaged ({error})") from error


class CheckpointWriter:
    """Writes checkpoints, one at a time, in another thread."""

    def __init__(self, folder: Path) -> None:
        """
        Args:
            folder: folder of the database.
        """
        self._path = folder / _NAME
        self._thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="checkpoints")
        self._writing: Future[int] | None = None

    @property
    def is_busy(self) -> bool:
        """Whether the result of a checkpoint was not taken yet."""
        return self._writing is not None

    def start(
        self, run_key: str, number: int, state: CapturedState, before: Callable[[], None]
    ) -> None:
        """Begin to write a checkpoint, while none is written.

        Args:
            run_key: unique name of its run.
            number: number of the last record that it contains.
            state: the state.
            before: called before in the same thread.
        """

        def write() -> int:
            before()
            return _write(self._path, run_key, number, state)

        self._writing = self._thread.submit(write)

    def take_result(self) -> int | None:
        """Return the last record that no checkpoint needs, once the one begun is written.

        Returns:
            None until then. 0 while there is only one: if it is damaged, all records are needed.

        Raises:
            sqlite3.Error, OSError: it cannot be written.
        """
        if self._writing is None or not self._writing.done():
            return None
        done, self._writing = self._writing, None
        return done.result()

    def close(self) -> None:
        """Wait until the checkpoint begun is written."""
        self._thread.shutdown()


def _write(path: Path, run_key: str, number: int, state: CapturedState) -> int:
    """Write a checkpoint, delete old ones, and return the last record that none needs."""
    content = state.compress()
    digest = hashlib.sha256(content).hexdigest()
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        connection.execute("pragma journal_mode = wal")
        connection.execute(_TABLE)
        connection.execute("begin immediate")
        row = (run_key, number, _FORMAT, _versions(), digest, content)
        connection.execute("insert or replace into checkpoints values (?, ?, ?, ?, ?, ?)", row)
        kept = connection.execute(
            "select number from checkpoints where run_key = ? order by number desc limit ?",
            (run_key, _NUM_KEPT),
        ).fetchall()
        oldest = int(kept[-1][0]) if len(kept) == _NUM_KEPT else 0
        connection.execute(
            "delete from checkpoints where run_key <> ? or number < ?", (run_key, oldest)
        )
        connection.execute("commit")
        return oldest


def _versions() -> str:
    return json.dumps(versions(), sort_keys=True)
