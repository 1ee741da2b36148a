"""Reserve ROS domains for tests, exclusively among all processes of the machine.

A domain in which something else runs, such as a simulation of the user, is not taken: the ports of
its participants are in use. RTPS 2.2, section 9.6.1, has the numbers of the ports.
"""

from __future__ import annotations

import errno
import fcntl
import itertools
import os
import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["TEST_DOMAIN_IDS", "NoFreeDomainError", "reserve_domain"]

TEST_DOMAIN_IDS = range(1, 102)
"""Domain ids for tests: 0 is the default domain, and from 102 on the ports are ephemeral."""

_FIRST_PORT, _PORTS_PER_DOMAIN, _FIRST_UNICAST_PORT = 7400, 250, 10
"""Port of multicast discovery in domain 0, its increment, and the distance of the unicast port."""

# Consecutive tests use different ids, because peers keep a killed node for some seconds. Each
# process starts at a different id.
_next = itertools.count(os.getpid())


class NoFreeDomainError(EarthmovingError):
    """All domains are reserved."""


@contextmanager
def reserve_domain(folder: Path | None = None) -> Iterator[int]:
    """Reserve a domain id while the block runs; it is freed even if the process is killed.

    Domains with participants on this machine are left out.

    Args:
        folder: folder of the lock files, the temporary folder of the system by default.

    Raises:
        NoFreeDomainError: every id is reserved or in use.
    """
    folder = folder or Path(tempfile.gettempdir())
    for _ in TEST_DOMAIN_IDS:
        domain = TEST_DOMAIN_IDS[next(_next) % len(TEST_DOMAIN_IDS)]
        lock = _lock(folder / f"ros_test_domain_{domain}.lock")
        if lock is None:
            continue
        if _is_in_use(domain):
            os.close(lock)
            continue
        try:
            yield domain
        finally:
            os.close(lock)  # releases the lock
        return
    raise NoFreeDomainError(
        f"all ROS domains from {TEST_DOMAIN_IDS[0]} to {TEST_DOMAIN_IDS[-1]} are reserved by"
        f" tests (lock files in {folder}), or nodes run in them; run fewer tests at once"
    )


def _is_in_use(domain: int) -> bool:
    """Return whether a participant of this machine is in a domain, by the ports of discovery."""
    base = _FIRST_PORT + _PORTS_PER_DOMAIN * domain
    for port in (base, base + _FIRST_UNICAST_PORT):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", port))
            except OSError as error:
                if error.errno == errno.EADDRINUSE:
                    return True
                raise
    return False


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
