"""NodeProcess: a node of a run in a process of its own; `stop_all` stops several in order."""

from __future__ import annotations

import re
import time
from collections.abc import Iterable, Sequence
from pathlib import Path

from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.processes import ChildProcess, python_module_command
from msg_bridge.processes.child_main import STACKS_SIGNAL

__all__ = [
    "STARTUP_STOP_TIMEOUT",
    "STOP_TIMEOUT",
    "NodeProcess",
    "NodeProcessError",
    "describe_logs",
    "stop_all",
    "waiting_reasons",
]

STOP_TIMEOUT = 60.0
"""Maximum wall time for a node to end after a signal [s]; a recorder has to finish its bag, on a
disk that may be slow."""

STARTUP_STOP_TIMEOUT = 2.0
"""The same before the first tick [s]: a node that compiles does not react to signals."""

_NUM_TAIL_LINES = 12
"""Lines shown from the end of a node's output when it fails."""

_NUM_STACK_LINES = 60
"""The same for a node that was killed because it did not end; its last lines are its calls."""

_STACKS_TIME = 1.0
"""Wall time in which a node that does not end prints its calls [s]."""

_ERROR = "[ERROR]"
_WAITING = re.compile(r"(waiting for|compiling kernels:) [^;]*", re.IGNORECASE)
"""What a node waits for or compiles; a hint for the user may follow after a semicolon."""


class NodeProcessError(EarthmovingError):
    """A node ended unexpectedly or with an error, or the run made no progress."""


class NodeProcess(ChildProcess):
    """A node in a process that ends with this one.

    Attributes:
        name: name of the node in messages.
        was_killed: whether `stop` has killed it.
    """

    def __init__(self, name: str, module: str, arguments: Sequence[str], log: Path) -> None:
        """
        Args:
            name: name of the node in messages.
            module: module to run.
            arguments: arguments of its command line.
            log: file for its output; it is replaced.
        """
        super().__init__(python_module_command(module, arguments), log)
        self.name = name
        self.was_killed = False

    def check(self) -> None:
        """Check that the node runs.

        Raises:
            NodeProcessError: it has ended; the message has the end of its output.
        """
        if self.exit_code is not None:
            raise NodeProcessError(
                f"{self.name} ended with exit code {self.exit_code}; its output is in {self.log}:"
                f"\n{self.tail(_NUM_TAIL_LINES)}"
            )

    def stop(self, timeout: float = STOP_TIMEOUT) -> int:
        """Interrupt the node, wait until it has ended, and return its exit code.

        If it does not end within `timeout` [s], it prints the calls of its threads and is killed.
        """
        if self.exit_code is None:
            self.interrupt()
        code = self.wait(timeout)
        if code is not None:
            return code
        self.was_killed = True
        self.interrupt(STACKS_SIGNAL)
        self.wait(_STACKS_TIME)
        return self.kill()


def stop_all(processes: Sequence[NodeProcess], timeout: float = STOP_TIMEOUT) -> list[str]:
    """Stop nodes one after the other; return a sentence for each that ended with an error.

    Args:
        processes: the nodes, in the order in which to stop them.
        timeout: maximum wall time for each to end [s]; then it is killed.
    """
    problems = []
    for process in processes:
        was_running = process.exit_code is None
        start_time = time.monotonic()
        code = process.stop(timeout)
        if not code or not was_running:
            continue
        seconds = time.monotonic() - start_time
        if process.was_killed:
            problems.append(
                f"{process.name} did not end within {timeout:g} s and was killed; its output is"
                f" in {process.log}:\n{process.tail(_NUM_STACK_LINES)}"
            )
        else:
            problems.append(
                f"{process.name} ended with exit code {code} after {seconds:.0f} s"
                f"{_last_error(process)}; its output is in {process.log}"
            )
    return problems


def _last_error(process: NodeProcess) -> str:
    """Return the last error in the output of a node, after a colon; empty without any."""
    errors = [line for line in process.output.splitlines() if _ERROR in line]
    return f": {errors[-1].partition(_ERROR)[2].strip()}" if errors else ""


def waiting_reasons(processes: Iterable[NodeProcess]) -> list[str]:
    """Return what each node waits for or compiles by the last line of its output, if it does."""
    reasons = []
    for process in processes:
        lines = process.output.splitlines()
        match = _WAITING.search(lines[-1]) if lines else None
        if match:
            reasons.append(f"{process.name} is {match[0]}")
    return reasons


def describe_logs(processes: Iterable[NodeProcess]) -> str:
    """Return the end of each node's output, each under a heading with the name of its file."""
    return "\n".join(
        f"  {process.name}, {process.log}:\n{process.tail(_NUM_TAIL_LINES) or '    (no output)'}"
        for process in processes
    )
