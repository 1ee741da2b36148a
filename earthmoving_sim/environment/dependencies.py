"""Checks of Python and of the packages that the simulation needs."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from importlib import metadata

from earthmoving_sim.environment.check_result import CheckResult, Status
from earthmoving_sim.environment.probe import probe

__all__ = ["DEPENDENCIES", "Dependency", "check_dependency", "check_python"]

MIN_PYTHON, MAX_PYTHON = (3, 10), (3, 13)
"""Versions for which there are ros-jazzy-* wheels."""


@dataclass(frozen=True)
class Dependency:
    """A package that the simulation needs.

    Attributes:
        distribution: name of the package.
        probe: code that fails unless the package works.
        breaks: advice if it is installed but does not work.
    """

    distribution: str
    probe: str
    breaks: str = "It is installed but does not work: `make distclean setup` installs it again."


DEPENDENCIES = (
    Dependency("numpy", "import numpy; numpy.linalg.inv(numpy.eye(2))"),
    Dependency(
        "numba",
        "import numba\nassert numba.njit(lambda a, b: a + b)(1, 2) == 3",
        "Its compiler (LLVM) must work: every soil kernel is compiled. Try NUMBA_CPU_NAME=generic; "
        "then `make distclean setup`.",
    ),
    Dependency(
        "pybullet",
        "import pybullet as p\nassert p.connect(p.DIRECT) >= 0\np.disconnect()",
        "The machines' dynamics need it. On Python 3.12 and later it is compiled on install, which "
        "takes g++ and the Python headers (Debian, Ubuntu: apt install g++ python3-dev).",
    ),
    Dependency("PyYAML", "import yaml"),
    Dependency("mcap", "import mcap.writer"),
    Dependency("rosbags", "import rosbags.rosbag2"),
    Dependency("rasterio", "import rasterio"),
    Dependency("pyarrow", "import pyarrow.parquet"),
    Dependency("matplotlib", "import matplotlib.figure"),
    Dependency("pillow", "import PIL.Image"),
    Dependency("aiohttp", "import aiohttp.web"),
    Dependency("msgpack", "import msgpack"),
)


def check_python() -> CheckResult:
    """Check that the running Python is in the supported range."""
    version = sys.version_info[:2]
    detail = f"{sys.version.split()[0]} at {sys.executable}"
    if MIN_PYTHON <= version <= MAX_PYTHON:
        return CheckResult("Python", Status.OK, detail)
    oldest, newest = (f"{major}.{minor}" for major, minor in (MIN_PYTHON, MAX_PYTHON))
    return CheckResult(
        "Python",
        Status.MISSING,
        detail,
        f"Needs Python {oldest} to {newest}, best 3.11: `make distclean setup PYTHON=python3.11`.",
    )


def check_dependency(dependency: Dependency) -> CheckResult:
    """Check that a package is installed and that its probe runs."""
    name = dependency.distribution
    try:
        version = metadata.version(name)
    except metadata.PackageNotFoundError:
        return CheckResult(
            name,
            Status.MISSING,
            "not installed",
            f"`make setup` installs it; elsewhere `pip install -c constraints.txt {name}`.",
        )
    problem = probe(dependency.probe)
    if problem is None:
        return CheckResult(name, Status.OK, version)
    return CheckResult(name, Status.MISSING, f"{version}, but: {problem}", dependency.breaks)
