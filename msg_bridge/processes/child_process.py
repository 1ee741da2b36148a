"""ChildProcess: a program in a session of its own, whose output goes to a file."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

__all__ = ["ChildProcess", "python_module_command"]


def python_module_command(module: str, arguments: Sequence[str] = ()) -> list[str]:
    """Return the command that runs a Python module which ends when this process dies."""
    launcher = "msg_bridge.processes.child_main"
    return [sys.executable, "-m", launcher, str(os.getpid()), module, *arguments]


class ChildProcess:
    """A running program.

    It has a session of its own: Ctrl-C in the terminal does not reach it, and all processes that
    it starts can be killed with it. It can be interrupted also where this process ignores SIGINT,
    as a shell's background job does, if it is started from the main thread.

    Attributes:
        command: program and arguments.
        log: file of its output, stdout and stderr together.
        pid: its process id.
    """

    def __init__(
        self, command: Sequence[str], log: Path, *, env: Mapping[str, str] | None = None
    ) -> None:
        """
        Args:
            command: program and arguments.
            log: file for the output; it is replaced.
            env: environment variables in addition to those of this process.
        """
        self.command = list(command)
        self.log = log
        with log.open("wb") as output, _default_interrupt():
            self._process = subprocess.Popen(
                self.command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env={**os.environ, "PYTHONUNBUFFERED": "1", **(env or {})},
                start_new_session=True,
            )
        self.pid = self._process.pid

    @property
    def exit_code(self) -> int | None:
        """Exit code; minus the signal's number if a signal ended it; None while it runs."""
        return self._process.poll()

    @property
    def output(self) -> str:
        """Output so far."""
        return self.log.read_text(encoding="utf-8", errors="replace")

    @property
    def cpu_time(self) -> float:
        """CPU time used so far [s]; 0 where there is no /proc."""
        try:
            fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            return 0.0
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def tail(self, num_lines: int) -> str:
        """Return the last lines of the output, indented."""
        return "\n".join(f"    {line}" for line in self.output.splitlines()[-num_lines:])

    def interrupt(self, number: int = signal.SIGINT) -> None:
        """Send a signal; do nothing if the process has ended."""
        self._process.send_signal(number)

    def wait(self, timeout: float) -> int | None:
        """Wait until the process ends; return its exit code, or None after `timeout` [s]."""
        try:
            return self._process.wait(timeout)
        except subprocess.TimeoutExpired:
            return None

    def kill(self) -> int:
        """Kill the process and all that it started; return its exit code."""
        # The process may have ended and others of its session still run.
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        return self._process.wait()


@contextlib.contextmanager
def _default_interrupt() -> Iterator[None]:
    """Let no program that is started meanwhile inherit that SIGINT is ignored."""
    is_main = threading.current_thread() is threading.main_thread()  # only it may set handlers
    if not is_main or signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        yield
        return
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
