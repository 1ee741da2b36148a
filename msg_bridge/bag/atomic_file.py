"""An unbuffered file in which each write succeeds completely or leaves no trace."""

from __future__ import annotations

import contextlib
import errno
from io import FileIO
from pathlib import Path

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["AtomicFile", "BagError", "write_error"]

_DISK_FULL_ERRNOS = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class BagError(EarthmovingError):
    """A bag cannot be written to the given path."""


class AtomicFile:
    """A new file.

    Attributes:
        has_failed: whether a write failed; the file ends with the one before.
    """

    def __init__(self, path: Path) -> None:
        """
        Raises:
            BagError: the file exists, or cannot be created.
        """
        self._path = path
        self._size = 0
        self.has_failed = False
        try:
            self._raw = FileIO(path, "xb")
        except OSError as error:
            raise write_error(path, error) from error

    @property
    def closed(self) -> bool:
        """Whether the file is closed."""
        return self._raw.closed

    def write(self, data: bytes) -> int:
        """Append bytes; return their number.

        Raises:
            BagError: they cannot be written, or an earlier write failed.
        """
        if self.has_failed:
            raise BagError(f"an earlier write to {self._path} failed; start another bag")
        remaining = memoryview(data)
        try:
            while remaining:
                remaining = remaining[self._raw.write(remaining) :]
        except OSError as error:
            self.has_failed = True
            with contextlib.suppress(OSError):
                self._raw.truncate(self._size)
            raise write_error(self._path, error) from error
        self._size += len(data)
        return len(data)

    def tell(self) -> int:
        """Return the size of the file [bytes]."""
        return self._size

    def close(self) -> None:
        """Close the file."""
        self._raw.close()


def write_error(path: Path, error: OSError) -> BagError:
    """Return the error for a file that cannot be written."""
    reason = error.strerror or str(error)
    if error.errno in _DISK_FULL_ERRNOS:
        return BagError(
            f"there is no disk space for {path} ({reason}); free some, or record elsewhere. What"
            " was recorded before can be read"
        )
    return BagError(f"{path} cannot be written ({reason}); give a writable path")
