"""How the kernels of the soil are compiled.

Numba makes three functions of each: the kernel, one through which Python calls it and one for C.
With tables of a dozen arrays as arguments the latter two take as long to compile as the first, so
what nobody calls is left out.

No fast maths, as in `machine_sim.jit`: a run would not repeat.
"""

from __future__ import annotations

from typing import Any

from numba import njit

from msg_bridge.kernel_cache import cached

__all__ = ["helper", "kernel"]

_njit: Any = njit  # its stubs do not know all options


def kernel(**options: Any) -> Any:
    """Compile a kernel that Python calls; `options` as of `numba.njit`."""

    def compiled(function: Any) -> Any:
        return cached(_njit(no_cfunc_wrapper=True, **options)(function))

    return compiled


def helper(**options: Any) -> Any:
    """Compile what only kernels call; it lies in their cache, and Python cannot call it."""
    return _njit(no_cfunc_wrapper=True, no_cpython_wrapper=True, **options)
