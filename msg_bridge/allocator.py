"""Freed memory: kept for the next large arrays, or returned to the system."""

from __future__ import annotations

import ctypes

__all__ = ["keep_freed_memory", "return_freed_memory"]

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # parameters of mallopt, malloc.h

_MAX_BLOCK_SIZE = 64 * 2**20
"""Size up to which blocks are taken from the heap [bytes]: a map of 1025 x 1025 columns."""

_MAX_FREE_SIZE = 256 * 2**20
"""Free memory at the end of the heap that is not returned to the system [bytes]."""


def keep_freed_memory() -> bool:
    """Let the C library reuse freed blocks of large arrays; return whether it does.

    By default it returns blocks of megabytes to the system when they are freed. The next map or
    image then gets new pages, each of which the system clears on first access: that took five to
    seven times as long as filling and serialising a map, in the middle of a tick. A process keeps
    its maximum size instead. Without effect where the C library is not glibc.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (OSError, AttributeError):
        return False
    return bool(mallopt(_M_MMAP_THRESHOLD, _MAX_BLOCK_SIZE)) and bool(
        mallopt(_M_TRIM_THRESHOLD, _MAX_FREE_SIZE)
    )


def return_freed_memory() -> bool:
    """Return free pages of the heap to the system; return whether there were any.

    Reading machine code from the cache and building a terrain leave tens of megabytes of them,
    which a node that runs for hours does not need again. Without effect where the C library is not
    glibc.
    """
    try:
        return bool(ctypes.CDLL(None).malloc_trim(0))
    except (OSError, AttributeError):
        return False
