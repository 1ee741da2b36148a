"""The journal of a node: the inputs of its run, and when a checkpoint of its state is due.

A node calls `append` before it sends what depends on an input, and `checkpoint_if_due` after each
tick. If nothing can be written, as on a full disk, the run continues without a journal, and is
journalled again as soon as a checkpoint can be written.
"""

from __future__ import annotations

import math
import pickle
import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from msg_bridge.checkpoint.state_pickle import CapturedState
from msg_bridge.codec.run_config import versions
from msg_bridge.recovery.checkpoints import CheckpointWriter, read_checkpoints
from msg_bridge.recovery.errors import RecoveryError
from msg_bridge.recovery.run_store import RunStore

__all__ = ["RunJournal", "SavedRun"]

_MIN_INTERVAL_RATIO = 50.0
"""Minimum time between two checkpoints, as a multiple of the time that capturing one takes: those
of large terrain take longer, and delay a tick."""


class SavedRun(NamedTuple):
    """A run that can be continued.

    Attributes:
        begin: what it began with.
        state: state of its newest checkpoint that can be used; None without one.
        number: number of the last record that the state contains; 0 without a state.
        num_records: number of the records after it.
        records: these records, in order.
        rejected: why each newer checkpoint cannot be used.
    """

    begin: Any
    state: Any
    number: int
    num_records: int
    records: Iterator[Any]
    rejected: tuple[str, ...]


class RunJournal:
    """The journal of the run of one node.

    Attributes:
        problem: why the run cannot be recovered now; empty if it can.
        num_checkpoints: number of checkpoints written by this process.
    """

    def __init__(
        self,
        folder: Path,
        checkpoint_period: float,
        *,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        """
        Args:
            folder: folder of the journal.
            checkpoint_period: wall time between two checkpoints [s].
            now: a monotonic wall clock [s].

        Raises:
            RecoveryError: the folder cannot be used.
        """
        self.problem = ""
        self.num_checkpoints = 0
        self._store = RunStore(folder)
        self._writer = CheckpointWriter(folder)
        self._period, self._now = checkpoint_period, now
        self._begin = b""
        self._number = 0  # of the last record
        self._is_suspended = True  # until a run begins, and while nothing can be written
        self._next_checkpoint = math.inf

    @property
    def number(self) -> int:
        """Number of the last record."""
        return self._number

    def saved_run(self) -> SavedRun | None:
        """Return the run that a process before did not end; None without one.

        Raises:
            RecoveryError: there is one, and it cannot be continued.
        """
        stored = self._store.stored_run()
        if stored is None:
            return None
        try:
            recorded, begin = pickle.loads(stored.begin)
        except (pickle.UnpicklingError, EOFError, AttributeError, ImportError, TypeError) as error:
            raise RecoveryError(f"its begin cannot be read ({error})") from error
        if recorded != versions():
            raise RecoveryError(f"it was written by {recorded}, and this is {versions()}")
        self._begin = stored.begin
        rejected: list[str] = []
        for checkpoint in self._readable_checkpoints(stored.run_key, rejected):
            try:
                state = checkpoint.load()
            except RecoveryError as error:
                rejected.append(f"the checkpoint after record {checkpoint.number}: {error}")
                continue
            return self._saved(begin, state, checkpoint.number, rejected)
        if stored.num_before:
            rejected.append(f"the inputs up to record {stored.num_before} were not written")
            raise RecoveryError("; ".join(rejected))
        return self._saved(begin, None, 0, rejected)

    def begin(self, begin: Any) -> None:
        """Begin the journal of a run; the one before is deleted.

        Args:
            begin: what the run begins with; it can be pickled.
        """
        self._begin = pickle.dumps((versions(), begin), protocol=pickle.HIGHEST_PROTOCOL)
        self._number = 0
        self.problem = ""
        self._start_store()

    def resume(self, saved: SavedRun) -> None:
        """Continue the journal of a saved run, whose records were processed."""
        self._number = saved.number + saved.num_records
        self._is_suspended = False
        self._start_segment()
        # The records after the last checkpoint need not be processed once more.
        self._next_checkpoint = self._now()

    def append(self, record: Any) -> None:
        """Write a record; it is in the journal when this returns, unless nothing can be written.

        Args:
            record: inputs of the run; they can be pickled.
        """
        self._number += 1
        if self._is_suspended:
            return
        try:
            self._store.append(self._number, pickle.dumps(record, pickle.HIGHEST_PROTOCOL))
        except sqlite3.Error as error:
            self._suspend(error)

    def checkpoint_if_due(self, capture: Callable[[bool], CapturedState | None]) -> None:
        """Write a checkpoint if it is time for one; call it after a tick.

        Args:
            capture: returns the state after the last record; None if it cannot be captured now, and
                is to be asked for again after the next tick. Its argument is whether a checkpoint
                has been due for a period.
        """
        now = self._now()
        if self._writer.is_busy:
            self._take_result()
        if now < self._next_checkpoint or self._writer.is_busy:
            return
        state = capture(now >= self._next_checkpoint + self._period)
        if state is None:
            return
        taken = self._now() - now
        self._next_checkpoint = now + max(self._period, _MIN_INTERVAL_RATIO * taken)
        if not (self._start_store() if self._is_suspended else self._start_segment()):
            return
        before = self._store.close_ended_segments
        self._writer.start(self._store.run_key, self._number, state, before)

    def end(self) -> None:
        """End the run: a process that is started later does not continue it."""
        self._is_suspended, self._next_checkpoint = True, math.inf
        with suppress(OSError):
            self._store.end_run()

    def close(self) -> None:
        """Finish a checkpoint that is being written, and let other processes use the folder."""
        self._writer.close()
        self._store.close()

    def _readable_checkpoints(self, run_key: str, rejected: list[str]) -> Iterator[Any]:
        """Yield checkpoints; a damaged database is added to `rejected`."""
        try:
            yield from read_checkpoints(self._store.folder, run_key)
        except RecoveryError as error:
            rejected.append(str(error))

    def _saved(self, begin: Any, state: Any, number: int, rejected: list[str]) -> SavedRun:
        """Return the run from a state on.

        Raises:
            RecoveryError: inputs after it are missing.
        """
        try:
            last = self._store.last_record(number)
        except RecoveryError as error:
            raise RecoveryError("; ".join([*rejected, str(error)])) from error
        records = (pickle.loads(each) for each in self._store.records(number))
        return SavedRun(begin, state, number, last - number, records, tuple(rejected))

    def _start_store(self) -> bool:
        """Begin to write the records from the next one on; return whether that is possible."""
        try:
            self._store.begin_run(self._begin, self._number)
        except (sqlite3.Error, OSError) as error:
            self._suspend(error)
            return False
        self._is_suspended = False
        if self._number == 0:
            self._next_checkpoint = self._now() + self._period
        return True

    def _start_segment(self) -> bool:
        """Write the records from the next one on to another file; return whether it is possible."""
        try:
            self._store.start_segment(self._number)
        except (sqlite3.Error, OSError) as error:
            self._suspend(error)
            return False
        return True

    def _suspend(self, error: Exception) -> None:
        """Continue without a journal; records after a gap are of no use."""
        self._is_suspended = True
        self.problem = (
            f"{self._store.folder} cannot be written ({error}): the run continues, but a restarted"
            " node cannot continue it; free some space"
        )
        self._next_checkpoint = self._now() + self._period
        with suppress(OSError):
            self._store.end_run()

    def _take_result(self) -> None:
        """Discard the records that no checkpoint needs, once the checkpoint begun is written."""
        try:
            unneeded = self._writer.take_result()
        except (sqlite3.Error, OSError) as error:
            self.problem = (
                f"a checkpoint cannot be written to {self._store.folder} ({error}); free some space"
            )
            return
        if unneeded is not None:
            self.num_checkpoints += 1
            self.problem = "" if not self._is_suspended else self.problem
            with suppress(OSError):
                self._store.discard_through(unneeded)
