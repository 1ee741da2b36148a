"""A damaged bag is read, or rejected with an error that names the file."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from msg_bridge.bag.mcap_index import index_file
from msg_bridge.bag.reader import BagReader, BagReadError

FILE = Path(__file__).parents[3] / "bags" / "format_2" / "format_2_0.mcap"
NUM_COPIES = 25
NUM_BYTES = 30


def read_all(path: Path) -> None:
    """Find and read all messages at random access."""
    index = BagReader(path).index(["/simulation/config", "/terrain/map", "/soil/ledger"])
    try:
        for number in range(0, index.size, 50):
            index.read(number)
    finally:
        index.close()


def changed_copies(path: Path, positions: list[int], seed: int) -> list[str]:
    """Read copies of the bag with random bytes changed; return the errors."""
    rng, errors = random.Random(seed), []
    for _ in range(NUM_COPIES):
        data = bytearray(FILE.read_bytes())
        for position in rng.choices(positions, k=NUM_BYTES):
            data[position] = rng.randrange(256)
        path.write_bytes(data)
        try:
            read_all(path)
        except BagReadError as error:
            errors.append(str(error))
    return errors


@pytest.mark.parametrize("is_chunk", [True, False], ids=["in chunks", "between chunks"])
def test_changed_bytes_are_read_or_rejected(tmp_path: Path, is_chunk: bool) -> None:
    chunks = {
        position
        for each in index_file(0, FILE).segments
        for position in range(each.offset, each.offset + each.length)
    }
    positions = [k for k in range(FILE.stat().st_size) if (k in chunks) is is_chunk]
    errors = changed_copies(tmp_path / "damaged.mcap", positions, seed=13)
    assert errors
    assert all("damaged.mcap" in error for error in errors)


def test_file_that_may_not_be_read_is_rejected(tmp_path: Path, monkeypatch) -> None:
    def reject(self: Path, mode: str) -> None:
        raise PermissionError(13, "Permission denied")

    path = tmp_path / "bag.mcap"
    path.write_bytes(FILE.read_bytes())
    monkeypatch.setattr(Path, "open", reject)
    with pytest.raises(BagReadError, match="Permission denied"):
        BagReader(path)
