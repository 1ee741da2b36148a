"""How the kernels of machines and particles are compiled.

One thread unless more are asked for: a second process on the machine stalls every barrier.

A division by zero gives infinity or NaN, as in NumPy: a check in a loop would keep it from being
vectorised.

No entries for C, which nobody calls and which take as long to compile as a small kernel.

No fast maths: where the compiler may reorder sums or fuse a product into one, a kernel that another
takes in comes out with other last bits than when it is called, and which of the two runs depends on
whether they were compiled now or come from the cache. A run would not repeat. It saves 0 to 10 %.
"""

from __future__ import annotations

from types import FunctionType
from typing import Any

import numba
from numba import njit

from msg_bridge.kernel_cache import cached

__all__ = ["ThreadedKernel", "inline_kernel", "kernel", "threaded_kernel", "use_threads"]

_njit: Any = njit  # its stubs do not know all options


def _compile(function: Any, **options: Any) -> Any:
    return cached(_njit(error_model="numpy", no_cfunc_wrapper=True, **options)(function))


def kernel(function: Any) -> Any:
    """Compile a kernel over arrays and scalars."""
    return _compile(function)


def inline_kernel(function: Any) -> Any:
    """Compile a helper that its callers take in whole, so that their loops stay vectorised."""
    return _compile(function, forceinline=True)


class ThreadedKernel:
    """A kernel with loops over `prange`, for one thread and for several.

    Several are compiled only where they are used: that takes seconds, and starts Numba's threads.
    """

    def __init__(self, function: FunctionType) -> None:
        self._serial = kernel(function)
        # Numba's cache tells kernels apart by name, not by how they are compiled.
        name = function.__name__ + "_threaded"
        twin = FunctionType(function.__code__, function.__globals__, name)
        twin.__qualname__, twin.__module__ = name, function.__module__
        self._parallel = _compile(twin, parallel=True)

    def for_threads(self, threads: int) -> Any:
        """The kernel for a number of threads."""
        return self._serial if threads == 1 else self._parallel


def threaded_kernel(function: Any) -> ThreadedKernel:
    """Compile a kernel for one thread and for several."""
    return ThreadedKernel(function)


def use_threads(threads: int) -> int:
    """Let the kernels that this thread calls next use `threads` threads, or as many as there are.

    Returns:
        How many.
    """
    threads = min(threads, numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]
    if threads > 1:
        # OpenMP's threads wait awake for the next loop, which comes within microseconds; the others
        # fall asleep, and waking them takes longer than a loop.
        numba.config.THREADING_LAYER_PRIORITY = ["omp", "tbb", "workqueue"]  # type: ignore[attr-defined]
        numba.set_num_threads(threads)
    return int(threads)
