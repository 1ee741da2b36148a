"""What every terrain file has in common: its suffix, how it is replaced, how its errors begin."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from msg_bridge.contract.errors import EarthmovingError
from soil_sim.errors import TerrainError

__all__ = ["SUFFIXES", "atomic_write", "check_file_exists", "validate_suffix", "wrap_read_errors"]

SUFFIXES = (".npy", ".npz", ".png", ".asc", ".tif", ".tiff")
"""What files of terrain are called."""


def validate_suffix(path: Path) -> str:
    """The suffix in lower case.

    Raises:
        TerrainError: it is none of `SUFFIXES`.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise TerrainError(f"suffix {path.suffix!r} is unknown; give one of {', '.join(SUFFIXES)}")
    return suffix


def check_file_exists(path: Path) -> None:
    """Refuse a path without a file.

    Raises:
        TerrainError: there is none, or it is a folder.
    """
    if not path.is_file():
        raise TerrainError("there is no such file; give the path of a terrain file")


@contextmanager
def wrap_read_errors(path: Path) -> Iterator[None]:
    """Errors of the block become a TerrainError whose message starts with the path."""
    try:
        yield
    except EarthmovingError as error:
        raise TerrainError(f"{path}: {error}") from error
    except OSError as error:
        raise TerrainError(f"{path}: it cannot be read ({error}); check the file") from error
    except MemoryError as error:
        raise TerrainError(f"{path}: it does not fit into memory; crop it first") from error


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """A file beside `path` that takes its place when the block ends well.

    Errors of the block become a TerrainError whose message starts with the path.
    """
    part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix.lower()}")
    try:
        try:
            yield part
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
    except EarthmovingError as error:
        raise TerrainError(f"{path}: {error}") from error
    except OSError as error:
        raise TerrainError(
            f"{path}: it cannot be written ({error}); give a folder that exists and is yours"
        ) from error
