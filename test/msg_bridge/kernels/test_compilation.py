"""Compilation is logged with its progress; kernels from the cache are not."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

SCRIPT = """\
from msg_bridge.kernels import kernel, log_compilation, warn_of_compilation

@kernel
def square(x):
    return x * x

@kernel
def cube(x):
    return square(x) * x

@kernel
def late(x):
    return x + 1.0

with log_compilation(lambda text: print("log:", text)):
    cube(2.0)
warn_of_compilation(lambda text: print("warning:", text))
late(1.0)
"""


def run_script(folder: Path) -> list[str]:
    """Run the script with a kernel cache in the folder; return its lines."""
    script = folder / "script.py"
    script.write_text(SCRIPT)
    done = subprocess.run(
        [sys.executable, str(script)],
        env={**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache")},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()


def test_first_run_logs_progress_and_late_compilation_and_the_next_run_nothing(
    tmp_path: Path,
) -> None:
    progress, end, warning = run_script(tmp_path)
    assert progress == "log: compiling kernels: 0 of 3, 0 s"
    assert end.startswith("log: compiled 2 kernels in ")
    assert warning.startswith("warning: compiled kernel __main__.late while running")
    assert run_script(tmp_path) == []
