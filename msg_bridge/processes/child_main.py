"""Run a Python module in a process that ends with its parent and can be interrupted.

    python -m msg_bridge.processes.child_main PARENT_PID MODULE [ARGUMENT ...]

The kernel sends SIGTERM to the process when its parent dies. This is requested before the module is
imported, so that no node outlives its parent, not even if the parent is killed while the node
starts. On systems without `prctl` (not Linux) it has no effect.

Python's handler of SIGINT is restored: a process inherits an ignored SIGINT, for example from a
shell's background job, and could not be interrupted.

A crash in a native library, and `STACKS_SIGNAL` at any time, print the calls of all Python threads.
"""

from __future__ import annotations

import ctypes
import faulthandler
import os
import runpy
import signal
import sys

__all__ = ["STACKS_SIGNAL", "main"]

STACKS_SIGNAL = signal.SIGUSR1
"""Signal on which the process prints the calls of its threads, also while native code runs."""

_PR_SET_PDEATHSIG = 1
"""Option of prctl(2): the signal sent to this process when its parent dies."""


def main(argv: list[str]) -> None:
    """Run the module named in the command line as `__main__`."""
    parent_pid, module, *arguments = argv
    _terminate_with_parent(int(parent_pid))
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if sys.stderr is not None:
        faulthandler.enable()
        faulthandler.register(STACKS_SIGNAL)
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


def _terminate_with_parent(parent_pid: int) -> None:
    try:
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, int(signal.SIGTERM))
    except (OSError, AttributeError):
        return
    if os.getppid() != parent_pid:  # the parent died before the request was made
        sys.exit(1)


if __name__ == "__main__":
    main(sys.argv[1:])
