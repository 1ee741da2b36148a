"""A ROS domain that no other test has at the same time, in whatever process it runs."""

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
"""Domain ids tests may have: 0 is everybody's, and from 102 on the ports are ephemeral ones."""

# Neighbouring tests take different ids: a node that was killed is remembered in its domain for
# some seconds. Processes begin at different ones.
_next = itertools.count(os.getpid())


class NoFreeDomainError(EarthmovingError):
    """All domains are taken."""


@contextmanager
def reserve_domain(folder: Path | None = None) -> Iterator[int]:
    """Hold a domain id while the block runs; the system gives it back if the process is killed.

    Args:
        folder: where the locks are, the system's temporary folder by default.

    Raises:
        NoFreeDomainError: every id is held.
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
            os.close(lock)  # and with it the lock
        return
    raise NoFreeDomainError(
        f"tests hold all ROS domains from {TEST_DOMAIN_IDS[0]} to {TEST_DOMAIN_IDS[-1]} (locks in {folder});"
        " run fewer tests at once"
    )


def _lock(path: Path) -> int | None:
    """An open file with the lock, or `None` if somebody else has it."""
    try:
        file = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
    except PermissionError:  # another user's
        return None
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(file)
        if error.errno in (errno.EAGAIN, errno.EACCES):
            return None
        raise
    return file
