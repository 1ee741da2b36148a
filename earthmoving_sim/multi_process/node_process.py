"""Nodes as processes: started together, watched, and stopped in order."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import IO

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["NodeProcess", "NodeProcessError", "stop_all"]

_STOP_TIMEOUT = 20.0
"""Wall time given to a node to end by itself [s]: a recorder may have a bag to finish."""

_NUM_TAIL_LINES = 12
"""Last lines of a node's output that are shown when it fails."""


class NodeProcessError(EarthmovingError):
    """A node ended that should not have, or ended badly."""


class NodeProcess:
    """One node in a process of its own; its output goes to a file.

    Attributes:
        name: what it is called in messages to the user.
        log: the file of its output.
    """

    def __init__(self, name: str, module: str, arguments: Sequence[str], log: Path) -> None:
        """
        Args:
            name: what to call it.
            module: run as `python -m`.
            arguments: of its command line.
            log: file for its output; replaced.
        """
        self.name = name
        self.log = log
        self._file: IO[bytes] = log.open("wb")
        self._process = subprocess.Popen(
            [sys.executable, "-m", module, *arguments],
            stdout=self._file,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            # Not in the terminal's group: Ctrl-C must not stop the recorder before the others.
            start_new_session=True,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )

    @property
    def exit_code(self) -> int | None:
        """Of the process; None while it runs."""
        return self._process.poll()

    @property
    def cpu_time(self) -> float:
        """CPU time it has used [s]; 0 where there is no /proc."""
        try:
            fields = Path(f"/proc/{self._process.pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            return 0.0
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def check(self) -> None:
        """See that it runs.

        Raises:
            NodeProcessError: it has ended; the message has the end of its output.
        """
        if self.exit_code is not None:
            raise NodeProcessError(
                f"{self.name} ended with exit code {self.exit_code}; its output is in {self.log}:"
                f"\n{self.tail()}"
            )

    def tail(self) -> str:
        """The last lines of its output."""
        self._file.flush()
        lines = self.log.read_text(encoding="utf-8", errors="replace").splitlines()
        return "\n".join(f"    {line}" for line in lines[-_NUM_TAIL_LINES:])

    def stop(self) -> int:
        """Ask it to end, wait until it has, and return its exit code; killed if it does not."""
        if self.exit_code is None:
            self._process.send_signal(signal.SIGINT)
        try:
            code = self._process.wait(_STOP_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            code = self._process.wait()
        self._file.close()
        return code


def stop_all(processes: Sequence[NodeProcess]) -> list[str]:
    """Stop nodes one after the other.

    Returns:
        A sentence for each that did not end well.
    """
    complaints = []
    for process in processes:
        was_running = process.exit_code is None
        began = time.monotonic()
        code = process.stop()
        if code and was_running:
            seconds = time.monotonic() - began
            complaints.append(
                f"{process.name} ended with exit code {code} after {seconds:.0f} s; its output"
                f" is in {process.log}"
            )
    return complaints
