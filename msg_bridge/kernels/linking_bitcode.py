"""The LLVM bitcode of kernels that were read from the cache.

Numba parses it when it loads the machine code, and keeps the result for kernels that are compiled
later and inline this one. It takes ten times the memory of the bitcode, 26 MB for the kernels of
the soil, and a process that finds all kernels in the cache never uses it.
"""

from __future__ import annotations

from typing import Any

from llvmlite.binding import parse_bitcode

__all__ = ["parse_when_linked"]


def parse_when_linked(library: Any, bitcode: bytes) -> None:
    """Release the parsed bitcode of a loaded kernel until another kernel is linked with it.

    Args:
        library: the kernel's `numba.core.codegen.JITCodeLibrary`.
        bitcode: what its module was parsed from.
    """
    library._shared_module.close()
    library._shared_module = None

    def module_for_linking() -> Any:
        if library._shared_module is None:
            library._shared_module = parse_bitcode(bitcode)
        return library._shared_module

    library._get_module_for_linking = module_for_linking
