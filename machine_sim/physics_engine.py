"""Import pybullet without its banner; all modules of the package import it from here.

While it is loaded, pybullet's C code prints "pybullet build time: ..." to standard error or output,
depending on its version. The banner would stand between the messages of every tool that uses the
package, so both file descriptors point to the null device during the import.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

__all__ = ["pybullet"]

_STDOUT, _STDERR = 1, 2


def _flush() -> None:
    """Write out what Python and the C library have buffered."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    ctypes.CDLL(None).fflush(None)


@contextmanager
def _discarded(descriptor: int) -> Iterator[None]:
    """Redirect a file descriptor of the process to the null device while the block runs."""
    try:
        saved = os.dup(descriptor)
    except OSError:  # it is closed
        yield
        return
    null = os.open(os.devnull, os.O_WRONLY)
    _flush()
    os.dup2(null, descriptor)
    os.close(null)
    try:
        yield
    finally:
        _flush()
        os.dup2(saved, descriptor)
        os.close(saved)


with ExitStack() as _discarding:
    _discarding.enter_context(_discarded(_STDOUT))
    _discarding.enter_context(_discarded(_STDERR))
    import pybullet
