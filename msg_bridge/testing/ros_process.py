"""RosProcess: a node in a process of its own, for tests."""

from __future__ import annotations

import os
import re
import signal
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from msg_bridge.processes import ChildProcess
from msg_bridge.testing.ros_context import DEADLINE

__all__ = ["RosProcess"]

_POLL_PERIOD = 0.02  # s between two looks at a process


class RosProcess:
    """A node as a process, with its output.

    Attributes:
        pid: its process id.
    """

    def __init__(
        self,
        command: Sequence[str | os.PathLike[str]],
        folder: Path,
        *,
        parameters: Mapping[str, Any] | None = None,
        namespace: str = "",
        name: str = "",
        env: Mapping[str, str] | None = None,
    ) -> None:
        """
        Args:
            command: program and arguments; ROS arguments are added.
            folder: for its output and parameter file; a new one.
            parameters: values by name, given as a parameter file.
            namespace, name: of the node, in place of its own.
            env: environment variables to set beside this process's.
        """
        words: list[str] = [os.fspath(word) for word in command]
        ros: list[str] = []
        if parameters:
            file = folder / "parameters.yaml"
            values = {"/**": {"ros__parameters": {k: _plain(v) for k, v in parameters.items()}}}
            file.write_text(yaml.safe_dump(values))
            ros += ["--params-file", str(file)]
        if namespace:
            ros += ["-r", f"__ns:={namespace}"]
        if name:
            ros += ["-r", f"__node:={name}"]
        full_command = [*words, "--ros-args", *ros] if ros else words
        self._expected_to_run = True
        self._process = ChildProcess(full_command, folder / "output.txt", env=env)
        self.pid = self._process.pid

    def __str__(self) -> str:
        return " ".join(self._process.command)

    @property
    def output(self) -> str:
        """What it has written so far, stdout and stderr together."""
        return self._process.output

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self._process.exit_code is None

    def wait_for_output(self, pattern: str, timeout: float = DEADLINE) -> re.Match[str]:
        """Wait until it has written something that matches a regular expression.

        Raises:
            AssertionError: it did not in time, or ended without.
        """
        deadline = time.monotonic() + timeout
        while True:
            ended = not self.running  # before the look at its output, which is then complete
            match = re.search(pattern, self.output, re.MULTILINE)
            if match:
                return match
            if ended:
                self._expected_to_run = False
                raise AssertionError(self._describe(f"ended without writing {pattern!r}"))
            assert time.monotonic() < deadline, self._describe(
                f"did not write {pattern!r} within {timeout:g} s"
            )
            time.sleep(_POLL_PERIOD)

    def interrupt(self, number: int = signal.SIGINT) -> None:
        """Send a signal and do not wait."""
        self._expected_to_run = False
        self._process.interrupt(number)

    def stop(
        self, number: int = signal.SIGINT, *, expect: int | None = 0, timeout: float = DEADLINE
    ) -> int:
        """Send a signal and wait for the end.

        Args:
            number: the signal.
            expect: the exit code it must have, `None` for any.
            timeout: maximum wait [s].

        Returns:
            The exit code; minus the signal's number if a signal ended it.

        Raises:
            AssertionError: another exit code, or no end in time, or it had ended before.
        """
        assert self.running, self._describe("had ended before it was to be stopped")
        self.interrupt(number)
        return self.wait(expect=expect, timeout=timeout)

    def wait(self, *, expect: int | None = 0, timeout: float = DEADLINE) -> int:
        """Wait until the process ends without a signal; otherwise as `stop`."""
        self._expected_to_run = False
        code = self._process.wait(timeout)
        assert code is not None, self._describe(f"did not end within {timeout:g} s")
        assert expect is None or code == expect, self._describe(f"should have ended with {expect}")
        return code

    def kill(self) -> None:
        """End it and all that it started, at once, without a chance to clean up."""
        self._expected_to_run = False
        self._process.kill()

    def failure_reason(self) -> str | None:
        """What is wrong if it should be running and is not; it is stated once."""
        if not self._expected_to_run or self.running:
            return None
        self._expected_to_run = False
        return self._describe("has ended unexpectedly")

    def crash(self) -> str | None:
        """What is wrong if it has ended, without a request, with an exit code other than 0 that no
        test has read."""
        return self.failure_reason() if self._process.exit_code else None

    def _describe(self, what: str) -> str:
        code = self._process.exit_code
        state = "it is running" if code is None else f"its exit code is {code}"
        return f"{self} {what}; {state} and its output:\n{self.output or '(nothing)'}"


def _plain(value: Any) -> Any:
    """A value as YAML of ROS parameters has it."""
    return list(value) if isinstance(value, tuple) else value
