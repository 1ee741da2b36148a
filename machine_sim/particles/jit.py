"""How the kernels of this folder are compiled.

One thread, no `prange`: a second process on the machine would stall every barrier, and one thread
adds in one order, so that a run repeats to the bit. Fast maths without the "no NaN, no infinity"
flags, so that a guard against them is not optimised away.

Numba's cache notices a change of the file a kernel is in, not of the kernels it calls: after an
edit of a kernel that other files use, delete `__pycache__`.
"""

from __future__ import annotations

from typing import Any

from numba import njit

__all__ = ["inline_kernel", "kernel"]

_FAST = {"contract", "reassoc", "arcp", "nsz"}


def kernel(function: Any) -> Any:
    """Compile a kernel over arrays and scalars."""
    return njit(cache=True, error_model="numpy", fastmath=_FAST)(function)


def inline_kernel(function: Any) -> Any:
    """Compile a helper that its callers take in whole, so that their loops stay vectorised."""
    return njit(cache=True, error_model="numpy", fastmath=_FAST, forceinline=True)(function)
