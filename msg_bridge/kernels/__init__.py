"""Compilation of Numba kernels, with options that soil and machines share.

- `decorators`: `kernel` and `helper`, with the options that all kernels are compiled with
- `fixed_signature`: `fixed_signature_kernel`, for kernels that are called many times in a step
- `boxed`: tables of arrays that are converted for kernels once, not in each call
- `llvm_vectors`: LLVM vectors of array elements, for intrinsics
- `threads`: kernels that run on one or on several threads
- `compilation`: progress of compilation, for the log of a process
- `cache`: compiled machine code on disk, keyed by the bytecode of all modules it was made from
"""

from msg_bridge.kernels.boxed import BoxedTable, box_table
from msg_bridge.kernels.compilation import log_compilation, warn_of_compilation
from msg_bridge.kernels.decorators import helper, kernel
from msg_bridge.kernels.fixed_signature import fixed_signature_kernel
from msg_bridge.kernels.threads import (
    ThreadedKernel,
    threaded_helper,
    threaded_kernel,
    threaded_stages,
    use_threads,
)

__all__ = [
    "BoxedTable",
    "ThreadedKernel",
    "box_table",
    "fixed_signature_kernel",
    "helper",
    "kernel",
    "log_compilation",
    "threaded_helper",
    "threaded_kernel",
    "threaded_stages",
    "use_threads",
    "warn_of_compilation",
]
