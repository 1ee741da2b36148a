"""Damages are described by what is wrong with the bytes, not by the text of an exception."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from mcap.records import Chunk
from mcap.stream_reader import get_chunk_data_stream

from msg_bridge.bag.bag_files import find_bag_files
from msg_bridge.bag.damage_text import describe_damage
from msg_bridge.bag.mcap_index import BagReadError


def chunk(compression: str, data: bytes, checksum: int = 0) -> Chunk:
    return Chunk(compression, data, 0, 0, checksum, 4)


@pytest.mark.parametrize(
    ("damaged", "text"),
    [
        (chunk("zstd", b"none"), "its compressed data cannot be decompressed"),
        (chunk("lz4", b"none"), "its compressed data cannot be decompressed"),
        (chunk("zstd", zstandard.compress(b"1234")[:-2]), "its compressed data cannot be"),
        (chunk("lz4", lz4.frame.compress(b"1234")[:-6]), "its compressed data cannot be"),
        (chunk("", b"1234", 7), f"its checksum is {zlib.crc32(b'1234'):08x}, but 00000007 is"),
    ],
)
def test_damaged_chunk_is_described(damaged: Chunk, text: str) -> None:
    with pytest.raises(Exception) as failure:  # noqa: PT011
        get_chunk_data_stream(damaged, validate_crc=True)
    assert isinstance(failure.value, Exception)
    assert describe_damage(failure.value).startswith(text)


def test_no_name_of_an_exception_is_shown() -> None:
    errors = [struct.error("unpack requires 8"), KeyError("a"), ValueError("x"), TypeError("int")]
    errors += [IndexError("list"), MemoryError(), UnicodeDecodeError("utf-8", b"x", 0, 1, "bad")]
    for error in errors:
        text = describe_damage(error)
        assert text.startswith(("its ", "it ", "a "))
        assert type(error).__name__ not in text


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("a: 1\nb: ]", "line 2 of it is no YAML"),
        ("a: 1", "it has no rosbag2_bagfile_information"),
        ("[1]", "its content is not as the format requires"),
    ],
)
def test_metadata_that_cannot_be_read_are_described(
    tmp_path: Path, content: str, text: str
) -> None:
    (tmp_path / "metadata.yaml").write_text(content)
    with pytest.raises(BagReadError, match=text):
        find_bag_files(tmp_path)
