"""Decorators that compile Numba kernels.

All kernels are compiled with these options:

- One thread: every barrier between threads waits for the slowest, so a second process on the
  machine stalls them all. `msg_bridge.kernels.threads` compiles kernels for several threads.
- `error_model="numpy"`: a division by zero gives infinity or NaN, as in NumPy. A check in a loop
  would prevent vectorisation.
- No wrapper that makes a kernel callable from C: nothing calls it, and with tables of a dozen
  arrays as arguments it takes as long to compile as the kernel itself.
- Negative indices count from the end, as in NumPy. Where an index was computed or read from an
  array, the compiler cannot know that it is not negative, and tests it in each access. In the few
  loops where that is a third of the time, kernels make it unsigned by `np.uint64`. Such an index
  must not meet a signed integer in arithmetic: Numba makes the result a float.
- No fast maths: where the compiler may reorder sums or fuse multiply and add, a kernel inlined into
  another one gives other last bits than the same kernel when it is called. Which of the two runs
  depends on what came from the cache, so runs would not be reproducible. It saves 0 to 10 %.
"""

from __future__ import annotations

from typing import Any

from numba import njit, types

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


def helper(function: Any = None, *, allocates: bool = False, **options: Any) -> Any:
    """Compile a function that only kernels can call; use as `kernel`.

    It has no wrapper for Python and no cache entry of its own: the machine code is part of the
    kernels that call it.

    Args:
        function: the function to compile.
        allocates: whether it makes arrays, returns any, or calls a kernel that returns any. All
            other helpers are compiled without reference counts: for each call those of a table of
            arrays take ten times as long as reading from it. So a loop over tables is in a helper
            of its own, and the kernel around it makes the arrays: which of its counts Numba
            removes from a loop depends on what the process compiled before.
        options: further options of `numba.njit`.
    """
    if function is None:
        return lambda function: helper(function, allocates=allocates, **options)
    dispatcher = _compile(function, no_cpython_wrapper=True, _nrt=allocates, **options)
    if not allocates:
        _check_when_compiled(dispatcher)
    return dispatcher


def _compile(function: Any, **options: Any) -> Any:
    return _njit(error_model="numpy", no_cfunc_wrapper=True, **options)(function)


def _check_when_compiled(dispatcher: Any) -> None:
    """Check a helper without reference counts for arrays of which it would have to count some.

    Its caller would release an array that it returns, and one that it gets from a kernel would
    never be released. Numba itself rejects a helper that makes an array.
    """
    compile_signature = dispatcher.compile

    def compile_and_check(signature: Any) -> Any:
        entry_point = compile_signature(signature)
        function = dispatcher.py_func
        callees = (function.__globals__.get(name) for name in function.__code__.co_names)
        for callee in (dispatcher, *callees):
            for compiled in getattr(callee, "nopython_signatures", ()):
                if _contains_array(compiled.return_type):
                    raise TypeError(
                        f"{callee.py_func.__qualname__} returns arrays: decorate"
                        f" {function.__qualname__} with helper(allocates=True)"
                    )
        return entry_point

    dispatcher.compile = compile_and_check


def _contains_array(kind: Any) -> bool:
    """Return whether a Numba type is an array, or a tuple with one."""
    if isinstance(kind, types.BaseTuple):
        return any(map(_contains_array, kind))  # type: ignore[call-overload]
    return isinstance(kind, types.Array)
