"""Decorators that compile Numba kernels.

All kernels are compiled with these options:

- One thread: every barrier between threads waits for the slowest, so a second process on the
  machine stalls them all. `msg_bridge.kernels.threads` compiles kernels for several threads.
- `error_model="numpy"`: a division by zero gives infinity or NaN, as in NumPy. A check in a loop
  would prevent vectorisation.
- No wrapper that makes a kernel callable from C: nothing calls it, and with tables of a dozen
  arrays as arguments it takes as long to compile as the kernel itself.
- No fast maths: where the compiler may reorder sums or fuse multiply and add, a kernel inlined into
  another one gives other last bits than the same kernel when it is called. Which of the two runs
  depends on what came from the cache, so runs would not be reproducible. It saves 0 to 10 %.
"""

from __future__ import annotations

from typing import Any

from numba import njit

from msg_bridge.kernels.cache import cached

__all__ = ["helper", "kernel"]

_njit: Any = njit  # its stubs lack some options


def kernel(function: Any = None, **options: Any) -> Any:
    """Compile a kernel that Python can call, and cache its machine code on disk.

    Use as `@kernel`, or as `@kernel(forceinline=True)` with further options of `numba.njit`:
    `forceinline` inlines it into its callers in LLVM, so that their loops stay vectorised;
    `inline="always"` copies its body into its callers before types are inferred.
    """
    if function is None:
        return lambda function: kernel(function, **options)
    return cached(_compile(function, **options))


def helper(function: Any = None, **options: Any) -> Any:
    """Compile a function that only kernels can call; use as `kernel`.

    It has no wrapper for Python and no cache entry of its own: the machine code is part of the
    kernels that call it.
    """
    if function is None:
        return lambda function: helper(function, **options)
    return _compile(function, no_cpython_wrapper=True, **options)


def _compile(function: Any, **options: Any) -> Any:
    return _njit(error_model="numpy", no_cfunc_wrapper=True, **options)(function)
