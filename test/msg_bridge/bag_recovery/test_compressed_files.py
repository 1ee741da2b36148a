"""Compressed messages are read, and compressed files recovered as far as their bytes allow."""

from __future__ import annotations

from pathlib import Path

import pytest
import zstandard
from support.text_bags import (
    CHUNK_SIZE,
    NUMBER,
    TOPIC,
    numbers_in,
    text,
    write_bag,
)

from earthmoving_sim.cli import main
from msg_bridge.bag.mcap_index import BagReadError
from msg_bridge.bag.reader import BagReader
from msg_bridge.bag_recovery import recover_bag


def compress(content: bytes) -> list[bytes]:
    """Return compressed data in blocks of the size of a chunk, as those of a large file."""
    frame = zstandard.ZstdCompressor().compressobj()
    blocks = [
        frame.compress(content[begin : begin + CHUNK_SIZE])
        + frame.flush(zstandard.COMPRESSOBJ_FLUSH_BLOCK)
        for begin in range(0, len(content), CHUNK_SIZE)
    ]
    return [*blocks, frame.flush()]


@pytest.mark.parametrize("case", ["complete", "cut off", "zeros", "damaged"])
def test_file_that_was_compressed_as_a_whole_is_decompressed_as_far_as_it_goes(
    tmp_path: Path, case: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write_bag(tmp_path / "dig", "none")
    blocks = compress(file.read_bytes())
    middle = len(blocks) // 2
    if case in ("cut off", "zeros"):
        blocks[middle:] = [blocks[middle][:1000], bytes(20_000 if case == "zeros" else 0)]
    elif case == "damaged":
        blocks[middle] = b"\xff" * 1000
    file.unlink()
    file.with_name("dig_0.mcap.zstd").write_bytes(b"".join(blocks))
    (tmp_path / "dig/metadata.yaml").unlink()
    with pytest.raises(BagReadError, match="earthmoving recover"):
        BagReader(tmp_path / "dig")
    assert main(["recover", str(tmp_path / "dig")]) == (1 if case == "damaged" else 0)
    output = capsys.readouterr().out
    assert "compressed as a whole" in output
    assert {
        "complete": "has its end",
        "cut off": "their end was not written",
        "zeros": "their end was not written",
        "damaged": "cannot be decompressed from there on",
    }[case] in output
    numbers = numbers_in(tmp_path / "dig-recovered")
    assert numbers == list(range(len(numbers)))
    assert NUMBER // 4 < len(numbers) < NUMBER or (case == "complete" and len(numbers) == NUMBER)
    assert len(list((tmp_path / "dig-recovered").iterdir())) == 2, "no temporary file is left"


def test_messages_that_were_compressed_one_by_one_are_decompressed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_bag(tmp_path / "dig", encode=zstandard.compress)
    assert main(["recover", str(tmp_path / "dig")]) == 0
    assert f"{NUMBER} messages compressed one by one" in capsys.readouterr().out
    assert numbers_in(tmp_path / "dig-recovered") == list(range(NUMBER))


def test_messages_that_were_compressed_one_by_one_are_read(tmp_path: Path) -> None:
    write_bag(tmp_path / "dig", encode=zstandard.compress)
    reader = BagReader(tmp_path / "dig")
    texts = [text(number) for number in range(NUMBER)]
    assert [data for _, _, data in reader.raw_messages()] == texts
    index = reader.index([TOPIC])
    try:
        assert [index.read(number) for number in range(index.size)] == texts
    finally:
        index.close()


def test_compressed_message_that_is_damaged_is_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut_off, damaged = text(7), text(8)

    def encode(data: bytes) -> bytes:
        content = zstandard.compress(data)
        if data == damaged:
            return content[:20] + bytes(100) + content[120:]
        return content[:-20] if data == cut_off else content

    write_bag(tmp_path / "dig", encode=encode)
    assert main(["recover", str(tmp_path / "dig")]) == 1
    assert "2 messages left out: the compressed data are damaged" in capsys.readouterr().out
    assert numbers_in(tmp_path / "dig-recovered") == [*range(7), *range(9, NUMBER)]
    reader = BagReader(tmp_path / "dig")
    with pytest.raises(BagReadError, match="earthmoving recover"):
        list(reader.raw_messages())
    index = reader.index([TOPIC])
    try:
        with pytest.raises(BagReadError, match="earthmoving recover"):
            index.read(7)
    finally:
        index.close()


def test_file_beside_its_unfinished_compressed_one_is_read_once(tmp_path: Path) -> None:
    """The recorder was killed while it compressed."""
    file = write_bag(tmp_path / "dig")
    file.with_name("dig_0.mcap.zstd").write_bytes(zstandard.compress(file.read_bytes())[:1000])
    (tmp_path / "dig/metadata.yaml").unlink()
    assert recover_bag(tmp_path / "dig", tmp_path / "recovered").messages == NUMBER
    assert BagReader(tmp_path / "dig").topics[TOPIC].count == NUMBER
