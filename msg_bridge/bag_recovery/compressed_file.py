"""Decompress a file that was compressed as a whole, as far as its data go.

`ros2 bag record --compression-format zstd` writes `.mcap.zstd` files with `--compression-mode
file`.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, NamedTuple

import zstandard

from msg_bridge.bag.atomic_file import write_error
from msg_bridge.bag.mcap_records import ZSTD_MAGIC

__all__ = ["Decompressed", "decompress", "is_compressed"]

_PIECE = 4096
"""Size of the pieces that are decompressed [bytes]; of a damaged one the begin is lost, too."""

_ZEROS = 64
"""Number of zeros at the end of a file by which its end was not written."""


class Decompressed(NamedTuple):
    """A decompressed file.

    Attributes:
        stream: its content, as far as it could be decompressed.
        end: number of bytes of the compressed file up to there.
        is_damaged: whether the bytes behind are no zstd data.
        is_cut_off: whether the file ends within its zstd data.
    """

    stream: IO[bytes]
    end: int
    is_damaged: bool
    is_cut_off: bool


def is_compressed(stream: IO[bytes]) -> bool:
    """Return whether a file at its begin is compressed by zstd as a whole."""
    begin = stream.read(len(ZSTD_MAGIC))
    stream.seek(0)
    return begin == ZSTD_MAGIC


@contextlib.contextmanager
def decompress(stream: IO[bytes], folder: Path) -> Iterator[Decompressed]:
    """Decompress a file into a temporary one, which is removed at the end.

    Args:
        stream: the file at its begin.
        folder: folder for the temporary file.

    Raises:
        BagError: there is no disk space for it.
        OSError: a file cannot be read.
    """
    with TemporaryFile(dir=folder) as target:
        frame, is_damaged = zstandard.ZstdDecompressor().decompressobj(), False
        end = 0
        while piece := stream.read(_PIECE):
            try:
                frame, content = _decompress_piece(frame, piece)
            except zstandard.ZstdError:
                is_damaged = not _ends_with_zeros(stream)
                break
            end = stream.tell()
            try:
                target.write(content)
            except OSError as error:
                raise write_error(folder, error) from error
        target.flush()
        yield Decompressed(target, end, is_damaged, not is_damaged and not frame.eof)


def _decompress_piece(
    frame: zstandard.ZstdDecompressionObj, piece: bytes
) -> tuple[zstandard.ZstdDecompressionObj, bytes]:
    """Return the frame in which a piece ends, and the content of the piece.

    Args:
        frame: the frame in which it begins.
        piece: compressed data.

    Raises:
        zstandard.ZstdError: it is damaged.
    """
    content = bytearray()
    while piece:
        if frame.eof:
            frame = zstandard.ZstdDecompressor().decompressobj()
        content += frame.decompress(piece)
        piece = frame.unused_data if frame.eof else b""
    return frame, bytes(content)


def _ends_with_zeros(stream: IO[bytes]) -> bool:
    """Return whether a file ends with zeros, as a system crash leaves them."""
    stream.seek(-min(_ZEROS, stream.seek(0, os.SEEK_END)), os.SEEK_END)
    return not stream.read().strip(b"\0")
