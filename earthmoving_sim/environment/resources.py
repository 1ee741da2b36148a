"""Checks of configuration files, output folder, cores and memory."""

from __future__ import annotations

import os
import shutil
import tempfile
from pathlib import Path

from earthmoving_sim.environment.check_result import CheckResult, Status
from msg_bridge.config_files import config_folder, shipped_configs

__all__ = [
    "MIB",
    "check_config",
    "check_cores",
    "check_memory",
    "check_output",
]

MIB = 2**20

MIN_MEMORY = 2048 * MIB
"""Soil, machine and viewer processes with Numba loaded, with a margin."""

MIN_DISK = 1024 * MIB
"""About half a minute of a recorder at its maximum of 29 MB/s."""

MIN_CORES = 2
"""Soil and machine nodes run side by side."""


def check_config() -> CheckResult:
    """Check that the configuration files of the package are found."""
    folder, names = config_folder(), shipped_configs()
    if names:
        return CheckResult("configuration", Status.OK, f"{len(names)} files in {folder}")
    return CheckResult(
        "configuration",
        Status.MISSING,
        f"none in {folder}" if folder else "its folder is missing",
        "The install is incomplete: run `make setup` in a checkout, `colcon build` in a workspace.",
    )


def check_output(folder: Path) -> CheckResult:
    """Check that runs can write to a folder, which is not created."""
    existing = folder.absolute()
    while not existing.exists():
        existing = existing.parent
    try:
        with tempfile.NamedTemporaryFile(dir=existing):
            pass
    except OSError as error:
        return CheckResult(
            "output folder",
            Status.MISSING,
            f"{folder} cannot be written: {error.strerror}",
            "Run from a folder you may write to, or name one with --output.",
        )
    free = shutil.disk_usage(existing).free
    return _capacity_check(
        "output folder",
        free >= MIN_DISK,
        f"{folder} ({_format_bytes(free)} free)",
        f"A long recording needs more than {_format_bytes(MIN_DISK)}: free some space, or write"
        " elsewhere.",
    )


def check_cores() -> CheckResult:
    """Check that soil and machines can run side by side."""
    cores = len(os.sched_getaffinity(0))
    return _capacity_check(
        "cores",
        cores >= MIN_CORES,
        f"{cores} to use",
        f"With fewer than {MIN_CORES}, soil and machines take turns: slower than real time.",
    )


def check_memory(meminfo: Path = Path("/proc/meminfo")) -> CheckResult:
    """Check that there is free memory for the nodes, by the kernel's `meminfo`."""
    fields = dict(line.split(":", 1) for line in meminfo.read_text().splitlines() if ":" in line)
    available = int(fields["MemAvailable"].split()[0]) * 1024  # the kernel's "kB" is KiB
    return _capacity_check(
        "memory",
        available >= MIN_MEMORY,
        f"{_format_bytes(available)} free",
        f"Less than {_format_bytes(MIN_MEMORY)}: close other programs, or use a smaller map.",
    )


def _capacity_check(name: str, is_enough: bool, detail: str, advice: str) -> CheckResult:
    """Return the result for a resource that may be small without preventing a run."""
    if is_enough:
        return CheckResult(name, Status.OK, detail)
    return CheckResult(name, Status.WARNING, detail, advice)


def _format_bytes(count: int) -> str:
    """Return a number of bytes as text."""
    return f"{count / 1024**3:.1f} GiB" if count >= 1024**3 else f"{count / MIB:.0f} MiB"
