"""Import pybullet without its banner; all modules of the package import it from here.

When it is loaded, pybullet's C code prints "pybullet build time: ..." to the process's standard
output, past `sys.stdout`. The banner would end up in the output of `--help` and of every tool that
prints data for other programs, so file descriptor 1 points to the null device during the import.
"""

from __future__ import annotations

import ctypes
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["pybullet"]


@contextmanager
def _discard_standard_output() -> Iterator[None]:
    """Send what C code writes to standard output to the null device while the block runs."""
    libc = ctypes.CDLL(None)
    if sys.stdout is not None:
        sys.stdout.flush()
    libc.fflush(None)
    try:
        saved = os.dup(1)
    except OSError:  # the process has no standard output
        yield
        return
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    os.close(null)
    try:
        yield
    finally:
        libc.fflush(None)  # a pipe is buffered: the banner is still in the C library's buffer
        os.dup2(saved, 1)
        os.close(saved)


with _discard_standard_output():
    import pybullet
