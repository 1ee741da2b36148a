"""Progress of compilation, for the log of a process.

A kernel is ready when its machine code was compiled or read from the cache. The number of kernels
in the messages is that of all imported modules; a few of them are for options that are not used.
"""

from __future__ import annotations

import gc
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["KernelState", "kernel_state", "log_compilation", "warn_of_compilation"]

Log = Callable[[str], object]

_LOG_PERIOD = 2.0
"""Minimum wall time between two messages of progress [s]."""

_GC_THRESHOLDS = (50_000, 20, 20)
"""Thresholds of the garbage collector during compilation, which makes millions of objects that
stay. It takes a fifth less time than with the defaults; without collection it would take no less
and twice the memory."""


class KernelState:
    """State of the kernels of this process; the cache updates it.

    Attributes:
        kernels: folder of the cache entry of each kernel, by name.
        ready: names of those with machine code.
        num_compiled: number of compilations so far.
        on_start: called before each compilation.
        on_end: called after each compilation that is not part of another one, with the name of the
            kernel and its wall time [s].
    """

    def __init__(self) -> None:
        self.kernels: dict[str, str] = {}
        self.ready: set[str] = set()
        self.num_compiled = 0
        self.on_start: Callable[[], None] | None = None
        self.on_end: Callable[[str, float], None] | None = None
        self._start_times: dict[str, float] = {}

    @property
    def cache_folder(self) -> str:
        """The folder that all cache entries are under."""
        return os.path.commonpath(self.kernels.values())

    def start(self, name: str) -> None:
        """Record that the compilation of a kernel starts."""
        self._start_times[name] = time.perf_counter()
        if self.on_start is not None:
            self.on_start()

    def end(self, name: str) -> None:
        """Record that a kernel was compiled and is in the cache."""
        duration = time.perf_counter() - self._start_times.pop(name, time.perf_counter())
        self.ready.add(name)
        self.num_compiled += 1
        if self.on_end is not None and not self._start_times:
            self.on_end(name, duration)


kernel_state = KernelState()
"""The state of this process."""


@contextmanager
def log_compilation(log: Log) -> Iterator[None]:
    """Log the progress while the block compiles kernels; nothing if all are in the cache.

    Args:
        log: takes each message.
    """
    state, start = kernel_state, time.perf_counter()
    num_before, last_message = state.num_compiled, -_LOG_PERIOD

    def on_start() -> None:
        nonlocal last_message
        now = time.perf_counter() - start
        if now - last_message >= _LOG_PERIOD:
            last_message = now
            log(f"compiling kernels: {len(state.ready)} of {len(state.kernels)}, {now:.0f} s")

    previous, state.on_start = state.on_start, on_start
    thresholds = gc.get_threshold()
    gc.set_threshold(*_GC_THRESHOLDS)
    try:
        yield
    finally:
        state.on_start = previous
        gc.set_threshold(*thresholds)
    num_compiled = state.num_compiled - num_before
    if num_compiled:
        log(f"compiled {num_compiled} kernels in {time.perf_counter() - start:.1f} s")


def warn_of_compilation(log: Log) -> None:
    """Log each compilation in this process from now on: it delays a tick.

    Args:
        log: takes each message, as a warning.
    """

    def on_end(name: str, duration: float) -> None:
        log(f"compiled kernel {name} while running, which took {duration:.1f} s")

    kernel_state.on_end = on_end
