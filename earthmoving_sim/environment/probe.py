"""Run a piece of code in another Python, so that a crash or a hang is a finding."""

from __future__ import annotations

import signal
import subprocess
import sys

__all__ = ["PROBE_TIMEOUT", "probe"]

PROBE_TIMEOUT = 120.0
"""Maximum wall time of a probe [s]: a first Numba compilation on a slow, busy computer."""


def probe(code: str, timeout: float = PROBE_TIMEOUT) -> str | None:
    """Return what goes wrong when another Python runs `code`; None if nothing does.

    Args:
        code: Python code.
        timeout: maximum wall time [s].
    """
    try:
        done = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=timeout,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"no answer within {timeout:g} s"
    if done.returncode == 0:
        return None
    if done.returncode < 0:
        return f"crashed with {signal.Signals(-done.returncode).name}"
    lines = done.stderr.strip().splitlines()
    return lines[-1] if lines else f"exit code {done.returncode}"
