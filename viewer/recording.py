"""RecorderProcess: an exchange_recorder that a page starts and stops."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from datetime import datetime, timezone
from pathlib import Path

from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.processes import ChildProcess, python_module_command
from viewer.server.backend import Recording

__all__ = ["RecorderProcess", "RecordingError"]

_MODULE = "msg_bridge.recorder.recorder_node"
_MIN_FREE_SPACE = 500 * 2**20
"""Free space on the disk below which no recording starts [bytes]."""
_STOP_TIME = 60.0
_MAX_REASON_LENGTH = 500


class RecordingError(EarthmovingError):
    """A recording cannot be started."""


class RecorderProcess:
    """At most one recorder at a time.

    Attributes:
        state: the present recording, or the last one and why it has failed;
            replaced as a whole, for other threads.
    """

    def __init__(self, folder: Path, simulation_namespace: str) -> None:
        """
        Args:
            folder: folder of the bags; created by the first recording.
            simulation_namespace: namespace of the recorder's status topic.
        """
        self.state = Recording(False, "", 0)
        self._folder, self._namespace = folder, simulation_namespace
        self._process: ChildProcess | None = None
        self._logs: tempfile.TemporaryDirectory[str] | None = None
        self._is_stopping = False

    def start(self) -> None:
        """Start a recording; do nothing if one runs.

        Raises:
            RecordingError: the disk is full, or the folder cannot be made.
        """
        if self._process is not None:
            return
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            free = shutil.disk_usage(self._folder).free
        except OSError as error:
            raise RecordingError(f"{self._folder} cannot be used: {error}") from None
        if free < _MIN_FREE_SPACE:
            raise RecordingError(f"only {free / 2**20:.0f} MiB are free in {self._folder}")
        now = datetime.now(timezone.utc).strftime("%Y-%m-%dT%H-%M-%S-%fZ")
        path = self._folder / f"page-{now}"
        self._logs = tempfile.TemporaryDirectory(prefix="viewer_recorder_")
        arguments = ["--ros-args", "-p", f"path:={path}", "-p", "progress:=false"]
        if self._namespace != "/":
            arguments += ["-r", f"__ns:={self._namespace}"]
        self._process = ChildProcess(
            python_module_command(_MODULE, arguments), Path(self._logs.name, "recorder.log")
        )
        self._is_stopping = False
        self.state = Recording(True, str(path), 0)

    def stop(self) -> None:
        """End the recording; `update` reports when it has ended."""
        if self._process is not None and not self._is_stopping:
            self._is_stopping = True
            self._process.interrupt()

    def update(self) -> None:
        """Update the state; call it about once a second."""
        process = self._process
        if process is None:
            return
        size = _size(Path(self.state.path))
        if process.exit_code is None:
            self.state = Recording(True, self.state.path, size)
            return
        reason = ""
        if process.exit_code != 0:
            lines = " ".join(process.tail(3).split())
            reason = f"the recorder has ended with an error: {lines[-_MAX_REASON_LENGTH:]}"
        elif not self._is_stopping:
            reason = "the recorder has ended without a request"
        self._end(size, reason)

    def close(self) -> None:
        """End the recording and wait until its file is complete."""
        if self._process is None:
            return
        self.stop()
        if self._process.wait(_STOP_TIME) is None:
            self._process.kill()
        self._end(_size(Path(self.state.path)))

    def _end(self, size: int, failure: str = "") -> None:
        self._process = None
        self.state = Recording(False, self.state.path, size, failure)
        if self._logs is not None:
            self._logs.cleanup()


def _size(folder: Path) -> int:
    """Return the size of the files of a folder [bytes]."""
    size = 0
    for path in folder.glob("*"):
        with contextlib.suppress(FileNotFoundError):  # the recorder has renamed it meanwhile
            size += path.stat().st_size if path.is_file() else 0
    return size
