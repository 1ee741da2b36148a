"""Kernels with loops over `numba.prange` that run on one or on several threads."""

from __future__ import annotations

from functools import cached_property, partial
from types import FunctionType
from typing import Any

import numba

from msg_bridge.kernels.decorators import helper
from msg_bridge.kernels.fixed_signature import fixed_signature_kernel

__all__ = [
    "ThreadedKernel",
    "threaded_helper",
    "threaded_kernel",
    "threaded_stages",
    "use_threads",
]


class ThreadedKernel:
    """A kernel with loops over `prange`, in a serial and in a parallel version.

    The parallel version is compiled only when it is called: that takes seconds, and starts Numba's
    threads. Each version runs the same version of the threaded kernels that it calls, and other
    kernels run the serial version.
    """

    def __init__(
        self,
        function: FunctionType,
        *,
        has_loops: bool = True,
        compile_: Any = fixed_signature_kernel,
    ) -> None:
        """
        Args:
            function: the function to compile.
            has_loops: whether it has loops over `prange` of its own; else only the kernels that it
                calls run on several threads.
            compile_: `fixed_signature_kernel`, or `helper` if Python never calls it.
        """
        self._function = function
        self._has_loops = has_loops
        self._compile = compile_
        self._serial = compile_(function)

    def for_threads(self, threads: int) -> Any:
        """Return the version of the kernel for a number of threads."""
        return self._serial if threads == 1 else self._parallel

    @property
    def _numba_type_(self) -> Any:
        """Type of this object for Numba, in a kernel that calls it."""
        return self._serial._numba_type_

    @cached_property
    def _parallel(self) -> Any:
        function = self._function
        # Numba's cache distinguishes kernels by name, not by the options they are compiled with.
        name = function.__name__ + "_threaded"
        scope = dict(function.__globals__)
        for key in function.__code__.co_names:
            if isinstance(scope.get(key), ThreadedKernel):
                scope[key] = scope[key]._parallel
        copy = FunctionType(function.__code__, scope, name)
        copy.__qualname__, copy.__module__ = name, function.__module__
        # Numba warns of parallel kernels without loops.
        return self._compile(copy, parallel=True) if self._has_loops else self._compile(copy)


def threaded_kernel(function: Any) -> ThreadedKernel:
    """Compile a kernel for one thread and for several."""
    return ThreadedKernel(function)


def threaded_helper(function: Any) -> ThreadedKernel:
    """Compile a function with loops over `prange` that only kernels call; see `helper`."""
    return ThreadedKernel(function, compile_=partial(helper, allocates=True))


def threaded_stages(function: Any) -> ThreadedKernel:
    """Compile a kernel that only calls other kernels, for one thread and for several."""
    return ThreadedKernel(function, has_loops=False)


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
