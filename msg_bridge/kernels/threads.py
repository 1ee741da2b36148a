"""Kernels with loops over `numba.prange` that run on one or on several threads."""

from __future__ import annotations

from types import FunctionType
from typing import Any

import numba

from msg_bridge.kernels.decorators import kernel

__all__ = ["ThreadedKernel", "threaded_kernel", "use_threads"]


class ThreadedKernel:
    """A kernel with loops over `prange`, in a serial and in a parallel version.

    The parallel version is compiled only when it is called: that takes seconds, and starts Numba's
    threads.
    """

    def __init__(self, function: FunctionType) -> None:
        self._serial = kernel(function)
        # Numba's cache distinguishes kernels by name, not by the options they are compiled with.
        name = function.__name__ + "_threaded"
        copy = FunctionType(function.__code__, function.__globals__, name)
        copy.__qualname__, copy.__module__ = name, function.__module__
        self._parallel = kernel(copy, parallel=True)

    def for_threads(self, threads: int) -> Any:
        """Return the version of the kernel for a number of threads."""
        return self._serial if threads == 1 else self._parallel


def threaded_kernel(function: Any) -> ThreadedKernel:
    """Compile a kernel for one thread and for several."""
    return ThreadedKernel(function)


def use_threads(threads: int) -> int:
    """Run the parallel kernels that this thread calls from now on with `threads` threads.

    Returns:
        The number of threads used: at most the number that Numba has.
    """
    threads = min(threads, numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]
    if threads > 1:
        # OpenMP's threads spin until the next loop, which starts within microseconds. Those of the
        # other layers sleep, and waking them takes longer than a loop.
        numba.config.THREADING_LAYER_PRIORITY = ["omp", "tbb", "workqueue"]  # type: ignore[attr-defined]
        numba.set_num_threads(threads)
    return int(threads)
