"""The journal of a run after its process ended without notice, on damaged files, on a full disk."""

from __future__ import annotations

import resource
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import msg_bridge.recovery.checkpoints
from msg_bridge.checkpoint.state_pickle import capture_state
from msg_bridge.recovery.errors import RecoveryError
from msg_bridge.recovery.run_journal import RunJournal, SavedRun

PERIOD = 5.0  # s between two checkpoints


class Process:
    """A process with a journal of numbers; its state is their sum."""

    def __init__(self, folder: Path) -> None:
        self.now, self.total = 0.0, 0
        self.journal = RunJournal(folder, PERIOD, now=lambda: self.now)

    def begin(self) -> Process:
        self.journal.begin("a run")
        return self

    def add(self, *numbers: int) -> None:
        for number in numbers:
            self.journal.append(number)
            self.total += number
            self.journal.checkpoint_if_due(lambda _: capture_state(np.array([self.total])))

    def checkpoint(self, *, fails: bool = False) -> None:
        """Let a checkpoint be due, and wait until it is written, or until it has failed."""
        count = self.journal.num_checkpoints
        self.now += PERIOD
        self.add(1000)
        deadline = time.monotonic() + 10.0
        while self.journal.num_checkpoints == count and not (fails and self.journal.problem):
            assert time.monotonic() < deadline
            self.journal.checkpoint_if_due(lambda _: None)

    def die(self) -> None:
        """End as a process that is killed: without a call of `end`."""
        self.journal.close()


def restored_total(saved: SavedRun) -> int:
    return (0 if saved.state is None else int(saved.state[0])) + sum(saved.records)


def saved_run(folder: Path) -> SavedRun:
    """Return the saved run of a folder, read to its end."""
    journal = RunJournal(folder, PERIOD)
    saved = journal.saved_run()
    assert saved is not None
    saved = saved._replace(records=iter(list(saved.records)))
    journal.close()
    return saved


@contextmanager
def full_disk(num_bytes: int = 40_000) -> Iterator[None]:
    """Let files grow to a size only."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (num_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def change_checkpoints(folder: Path, statement: str) -> None:
    with closing(sqlite3.connect(folder / "checkpoints.sqlite")) as connection:
        connection.execute(statement)
        connection.commit()


def change_inputs(folder: Path, statement: str) -> None:
    with closing(sqlite3.connect(folder / "inputs_000000000001.sqlite")) as connection:
        connection.execute(statement)
        connection.commit()


@pytest.fixture
def twice_checkpointed(tmp_path: Path) -> Process:
    """A process that died after two checkpoints."""
    process = Process(tmp_path).begin()
    process.add(1, 2)
    process.checkpoint()
    process.add(3)
    process.checkpoint()
    process.add(4, 5)
    process.die()
    return process


def test_run_continues_from_its_begin_and_its_inputs(tmp_path: Path) -> None:
    process = Process(tmp_path).begin()
    process.add(1, 2, 3)
    process.die()
    saved = saved_run(tmp_path)
    assert (saved.begin, saved.state, saved.num_records) == ("a run", None, 3)
    assert restored_total(saved) == 6


def test_run_continues_from_the_newest_checkpoint(
    tmp_path: Path, twice_checkpointed: Process
) -> None:
    saved = saved_run(tmp_path)
    assert saved.num_records == 2
    assert restored_total(saved) == twice_checkpointed.total == 2015
    other = Process(tmp_path)
    again = other.journal.saved_run()
    assert again is not None
    other.total = restored_total(again)
    other.journal.resume(again)
    other.add(7)
    other.die()
    assert restored_total(saved_run(tmp_path)) == 2022


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ("content = zeroblob(100)", "checksum"),
        ("content = substr(content, 1, length(content) - 1)", "truncated"),
        ("""versions = '{"earthmoving_sim": "0.0.1"}'""", "0.0.1"),
        ("format = 99", "written by"),
    ],
)
def test_checkpoint_that_cannot_be_used_is_replaced_by_the_one_before(
    tmp_path: Path, twice_checkpointed: Process, change: str, reason: str
) -> None:
    newest = "(select max(number) from checkpoints)"
    change_checkpoints(tmp_path, f"update checkpoints set {change} where number = {newest}")
    saved = saved_run(tmp_path)
    assert reason in saved.rejected[0]
    assert saved.num_records == 4
    assert restored_total(saved) == twice_checkpointed.total


def test_run_without_a_usable_checkpoint_needs_all_inputs(tmp_path: Path) -> None:
    process = Process(tmp_path).begin()
    process.add(1, 2)
    process.checkpoint()
    process.add(3)
    process.die()
    change_checkpoints(tmp_path, "update checkpoints set sha256 = ''")
    assert restored_total(saved_run(tmp_path)) == process.total
    (tmp_path / "checkpoints.sqlite").write_bytes(b"no database" * 1000)
    assert restored_total(saved_run(tmp_path)) == process.total
    change_inputs(tmp_path, "delete from records where number = 2")
    with pytest.raises(RecoveryError, match="lacks inputs"):
        saved_run(tmp_path)


def test_inputs_that_no_checkpoint_needs_are_deleted(tmp_path: Path) -> None:
    process = Process(tmp_path).begin()
    for _ in range(5):
        process.add(*range(100))
        process.checkpoint()
    process.add(*range(400))
    process.die()
    first = min(int(path.stem.rpartition("_")[2]) for path in tmp_path.glob("inputs_*.sqlite"))
    assert first == 4 * 101 + 1, "one after the last checkpoint but one"
    assert restored_total(saved_run(tmp_path)) == process.total


@pytest.mark.parametrize("name", ["run.sqlite", "inputs_000000000001.sqlite"])
@pytest.mark.parametrize("damage", [b"", b"x" * 5000, None])
def test_damaged_journal_is_rejected(tmp_path: Path, name: str, damage: bytes | None) -> None:
    process = Process(tmp_path).begin()
    process.add(1, 2, 3)
    process.die()
    if damage is None:
        change_inputs(tmp_path, "update records set content = zeroblob(5) where number = 2")
    else:
        (tmp_path / name).write_bytes(damage)
    with pytest.raises(RecoveryError, match="damaged"):
        saved_run(tmp_path)


def test_run_of_another_version_is_rejected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Process(tmp_path).begin().die()
    monkeypatch.setattr("msg_bridge.recovery.run_journal.versions", lambda: {"numpy": "0.1"})
    with pytest.raises(RecoveryError, match=r"0\.1"):
        saved_run(tmp_path)


def test_process_that_dies_while_it_begins_a_segment_loses_nothing(tmp_path: Path) -> None:
    process = Process(tmp_path).begin()
    process.add(1, 2, 3)
    process.die()
    (tmp_path / "part.sqlite").write_bytes(b"a database that is not complete")
    other = Process(tmp_path)
    saved = other.journal.saved_run()
    assert saved is not None
    other.total = restored_total(saved)
    other.journal.resume(saved)
    other.add(4)
    other.die()
    assert restored_total(saved_run(tmp_path)) == 10


def test_run_that_was_ended_is_not_continued(tmp_path: Path) -> None:
    process = Process(tmp_path).begin()
    process.add(1)
    process.journal.end()
    process.die()
    assert RunJournal(tmp_path, PERIOD).saved_run() is None


def test_folder_is_used_by_one_process(tmp_path: Path) -> None:
    process = Process(tmp_path)
    with pytest.raises(RecoveryError, match="another process"):
        RunJournal(tmp_path, PERIOD)
    process.die()


def test_folder_that_cannot_be_made_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RecoveryError, match="give another folder"):
        RunJournal(tmp_path / "file" / "below", PERIOD)


def test_full_disk_ends_the_journal_until_there_is_space(tmp_path: Path) -> None:
    process = Process(tmp_path).begin()
    with full_disk():
        process.add(*range(5000))
        assert "free some space" in process.journal.problem
        process.now += PERIOD  # it tries again
        process.add(1)
        assert process.journal.problem
    process.checkpoint()
    assert not process.journal.problem
    process.add(2, 3)
    process.die()
    assert restored_total(saved_run(tmp_path)) == process.total


def test_process_that_dies_on_a_full_disk_leaves_no_older_state(tmp_path: Path) -> None:
    process = Process(tmp_path).begin()
    process.checkpoint()
    with full_disk():
        process.add(*range(5000))
    process.die()
    assert RunJournal(tmp_path, PERIOD).saved_run() is None


def test_checkpoint_that_cannot_be_written_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*args: Any) -> int:
        raise sqlite3.OperationalError("database or disk is full")

    process = Process(tmp_path).begin()
    with monkeypatch.context() as patch:
        patch.setattr(msg_bridge.recovery.checkpoints, "_write", fail)
        process.checkpoint(fails=True)
        assert "disk is full" in process.journal.problem
    process.checkpoint()
    assert not process.journal.problem
    process.die()
    assert restored_total(saved_run(tmp_path)) == process.total


WRITER = """
import sys, time
from pathlib import Path
import numpy as np
from msg_bridge.checkpoint.state_pickle import capture_state
from msg_bridge.recovery.run_journal import RunJournal

journal, total = RunJournal(Path(sys.argv[1]), 0.002), 0
journal.begin("a run")
ballast = np.random.default_rng(0).random(100_000)
for number in range(1_000_000):
    journal.append(number)
    total += number
    journal.checkpoint_if_due(lambda _: capture_state((np.array([total]), ballast)))
    print(number, flush=True)
"""


@pytest.mark.parametrize("num_lines", [1, 40, 400, 1500])
def test_killed_process_has_stored_each_input(tmp_path: Path, num_lines: int) -> None:
    command = [sys.executable, "-c", WRITER, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for _ in range(num_lines):
            process.stdout.readline()
        process.send_signal(signal.SIGKILL)
        lines = process.stdout.read().splitlines()
    acknowledged = num_lines + sum(1 for line in lines if line.isdigit())
    saved = saved_run(tmp_path)
    total = (0 if saved.state is None else int(saved.state[0][0])) + sum(saved.records)
    count = saved.number + saved.num_records
    assert count in (acknowledged - 1, acknowledged, acknowledged + 1)
    assert total == sum(range(count))
