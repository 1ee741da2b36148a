"""The folder of a new bag, which can be left as it was before."""

from __future__ import annotations

import contextlib
from pathlib import Path

from msg_bridge.bag.atomic_file import BagError, write_error
from msg_bridge.bag.output_path import describe_obstacle

__all__ = ["OutputFolder"]


class OutputFolder:
    """An empty folder, made with its parents where they are missing.

    It may be a symbolic link to an empty folder: the bag is written there, and the link stays.

    Attributes:
        path: the folder.
    """

    def __init__(self, path: Path) -> None:
        """
        Raises:
            BagError: it is a file or a broken link, is not empty, or cannot be made.
        """
        obstacle = describe_obstacle(path)
        if obstacle:
            raise BagError(obstacle)
        self.path = path
        self._made: list[Path] = []  # in the order in which they were made
        try:
            self._make()
            existing = next(path.iterdir(), None)
        except OSError as error:
            self._remove_folders()
            raise write_error(path, error) from error
        if existing is not None:
            raise BagError(
                f"{path} is not empty (it has {existing.name}); give another by --output"
            )

    def remove(self) -> None:
        """Remove the files in the folder, which was empty, and the folders that were made."""
        with contextlib.suppress(OSError):
            for file in self.path.iterdir():
                file.unlink()
        self._remove_folders()

    def _remove_folders(self) -> None:
        for folder in reversed(self._made):
            with contextlib.suppress(OSError):  # another program has written into it
                folder.rmdir()

    def _make(self) -> None:
        missing = []
        for folder in (self.path, *self.path.parents):
            if folder.exists():
                break
            missing.append(folder)
        for folder in reversed(missing):
            folder.mkdir()
            self._made.append(folder)
