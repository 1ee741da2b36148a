"""What is in the way of an output folder."""

from __future__ import annotations

from pathlib import Path

__all__ = ["describe_obstacle"]


def describe_obstacle(path: Path) -> str:
    """Return why a folder cannot be made or used, and what to do; empty if nothing is in the way.

    Args:
        path: the folder, which may be missing like its parents, or be a link to one that exists.
    """
    for folder in (path, *path.parents):
        if folder.is_symlink() and not folder.exists():
            return (
                f"{folder} is a symbolic link to {folder.readlink()}, which does not exist; make"
                " that folder, or give another by --output"
            )
        if folder.exists():
            return "" if folder.is_dir() else f"{folder} is a file; give a folder by --output"
    return ""
