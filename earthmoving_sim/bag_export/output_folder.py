"""The folder of the tables of a bag: empty, or with a former export only."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from earthmoving_sim.bag_export.parquet_file import PART_SUFFIX, ExportError, to_export_error
from msg_bridge.bag.output_path import describe_obstacle

__all__ = ["check_folder", "remove_former_export"]

_PARQUET_MAGIC = b"PAR1"
_SOFTWARE = b"earthmoving_sim"


def check_folder(folder: Path, *, overwrite: bool) -> None:
    """Check that tables can be written into a folder.

    Args:
        folder: the folder; it may be missing.
        overwrite: whether it may contain a former export.

    Raises:
        ExportError: it contains anything else.
    """
    obstacle = describe_obstacle(folder)
    if obstacle:
        raise ExportError(obstacle)
    if not folder.exists():
        return
    if overwrite:
        foreign = next((path for path in folder.rglob("*") if not _is_of_an_export(path)), None)
        if foreign is not None:
            raise ExportError(
                f"{foreign} was not made by an export, so {folder} is not overwritten; give another"
                " folder by --output"
            )
    elif any(folder.iterdir()):
        raise ExportError(
            f"{folder} is not empty; give another folder by --output, or replace a former export by"
            " --overwrite"
        )


def remove_former_export(folder: Path) -> None:
    """Remove the content of a folder that `check_folder` has accepted.

    Raises:
        ExportError: a file cannot be removed.
    """
    try:
        for path in sorted(folder.rglob("*"), reverse=True):  # files before their folders
            if path.is_dir():
                path.rmdir()
            else:
                path.unlink()
    except OSError as error:
        raise to_export_error(folder, error) from error


def _is_of_an_export(path: Path) -> bool:
    """Return whether an export makes such a file or folder."""
    if path.is_symlink():
        return False
    if path.is_dir():
        return True
    if path.suffix == PART_SUFFIX:  # left by an export that was killed
        with path.open("rb") as stream:
            return stream.read(len(_PARQUET_MAGIC)) == _PARQUET_MAGIC
    try:
        metadata = pq.read_schema(path).metadata or {}
    except (OSError, pa.ArrowException):
        return False
    software: bytes = metadata.get(b"software", b"")
    return software.startswith(_SOFTWARE)
