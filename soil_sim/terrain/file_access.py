"""Suffixes, atomic writes and error messages of terrain files."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from msg_bridge.contract.errors import ParameterError
from soil_sim.errors import TerrainError, TerrainErrorCode

__all__ = ["SUFFIXES", "atomic_write", "check_file_exists", "validate_suffix", "wrap_read_errors"]

SUFFIXES = (".npy", ".npz", ".png", ".asc", ".tif", ".tiff")
"""Suffixes of terrain files."""


def validate_suffix(path: Path) -> str:
    """Return the suffix of a path in lower case.

    Raises:
        TerrainError: it is not in `SUFFIXES`.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise TerrainError(
            f"suffix {path.suffix!r} is unknown; give one of {', '.join(SUFFIXES)}",
            TerrainErrorCode.UNSUPPORTED,
        )
    return suffix


def check_file_exists(path: Path) -> None:
    """Check that a file exists.

    Raises:
        TerrainError: there is no file, or it is a folder.
    """
    if not path.is_file():
        raise TerrainError(
            "there is no such file; give the path of a terrain file", TerrainErrorCode.NO_FILE
        )


@contextmanager
def wrap_read_errors(path: Path) -> Iterator[None]:
    """Convert errors of the block to a TerrainError whose message starts with the path.

    A TerrainError keeps its code.
    """
    try:
        yield
    except TerrainError as error:
        raise TerrainError(f"{path}: {error}", error.code) from error
    except ParameterError as error:  # of a Grid, about its spacing
        raise TerrainError(f"{path}: {error}", TerrainErrorCode.CELL_SIZE) from error
    except OSError as error:
        raise TerrainError(
            f"{path}: it cannot be read ({error}); check the file", TerrainErrorCode.UNREADABLE
        ) from error
    except MemoryError as error:
        raise TerrainError(
            f"{path}: it does not fit into memory; crop it first", TerrainErrorCode.UNREADABLE
        ) from error


@contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Yield a temporary path whose file replaces `path` if the block succeeds.

    Errors of the block are converted to a TerrainError whose message starts with the path; a
    TerrainError keeps its code.
    """
    part = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix.lower()}")
    try:
        try:
            yield part
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
    except TerrainError as error:
        raise TerrainError(f"{path}: {error}", error.code) from error
    except OSError as error:
        raise TerrainError(
            f"{path}: it cannot be written ({error}); give an existing folder with write"
            " permission",
            TerrainErrorCode.UNWRITABLE,
        ) from error
