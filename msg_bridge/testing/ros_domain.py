"""Reserve ROS domains for tests, exclusively among all processes of the machine."""

from __future__ import annotations

import errno
import fcntl
import itertools
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["TEST_DOMAIN_IDS", "NoFreeDomainError", "reserve_domain"]

TEST_DOMAIN_IDS = range(1, 102)
"""Domain ids for tests: 0 is the default domain, and from 102 on the ports are ephemeral."""

# Consecutive tests use different ids, because peers keep a killed node for some seconds. Each
# process starts at a different id.
_next = itertools.count(os.getpid())


class NoFreeDomainError(EarthmovingError):
    """All domains are reserved."""


@contextmanager
def reserve_domain(folder: Path | None = None) -> Iterator[int]:
    """Reserve a domain id while the block runs; it is freed even if the process is killed.

    Args:
        folder: folder of the lock files, the temporary folder of the system by default.

    Raises:
        NoFreeDomainError: every id is reserved.
    """
    folder = folder or Path(tempfile.gettempdir())
    for _ in TEST_DOMAIN_IDS:
        domain = TEST_DOMAIN_IDS[next(_next) % len(TEST_DOMAIN_IDS)]
        lock = _lock(folder / f"ros_test_domain_{domain}.lock")
        if lock is None:
            continue
        try:
            yield domain
        finally:
            os.close(lock)  # releases the lock
        return
    raise NoFreeDomainError(
        f"all ROS domains from {TEST_DOMAIN_IDS[0]} to {TEST_DOMAIN_IDS[-1]} are reserved by"
        f" tests (lock"
        f" files in {folder}); run fewer tests at once"
    )


def _lock(path: Path) -> int | None:
    """Return an open file with the lock, or None if another process has it."""
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    except PermissionError:  # of another user
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(file)
        if error.errno in (errno.EAGAIN, errno.EACCES):
            return None
        raise
    return file
