"""Check that this machine has what the simulation needs, and say what to do where it has not.

Every line is one check: ✓ is fine, ! works but may disappoint, ✗ must be mended first.
Exits with 1 if there is a ✗.
"""

import argparse
import enum
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

from msg_bridge.config_files import config_folder, shipped_configs

__all__ = ["SUMMARY", "CheckResult", "Status", "add_arguments", "all_checks", "run"]

SUMMARY = "check that this machine has what the simulation needs"

MIN_PYTHON, MAX_PYTHON = (3, 10), (3, 13)  # the range that has ros-jazzy-* wheels
ROS_DISTRO = "jazzy"

MIB = 2**20
MIN_SHARED_MEMORY = 256 * MIB  # one 32 MiB Fast DDS segment for each of a handful of nodes
MIN_MEMORY = 2048 * MIB  # soil, machine and viewer processes with numba loaded, with room to spare
MIN_DISK = 1024 * MIB  # about half a minute of a recorder at its full 29 MB/s
MIN_CORES = 2  # soil and machine nodes run side by side

PROBE_TIMEOUT_S = 120.0  # a first numba compile on a slow, busy machine


class Status(enum.Enum):
    """Outcome of one check; the value is the sign printed before it."""

    OK = "✓"
    WARNING = "!"
    MISSING = "✗"


@dataclass(frozen=True)
class CheckResult:
    """What one check found, `detail`, and unless all is well what to do about it, `advice`."""

    name: str
    status: Status
    detail: str
    advice: str = ""

    def __str__(self) -> str:
        line = f"{self.status.value} {self.name:<14} {self.detail}"
        return f"{line}\n  → {self.advice}" if self.advice else line


@dataclass(frozen=True)
class Dependency:
    """A package the simulation needs, and code that shows it works, not only that it is there."""

    distribution: str
    probe: str
    breaks: str = "It is installed but does not work: `make distclean setup` installs it afresh."


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
    Dependency("matplotlib", "import matplotlib.figure"),
    Dependency("pillow", "import PIL.Image"),
)

# An Imu holds fixed-size arrays, so that the messages' C code meets this environment's NumPy.
RCLPY_PROBE = """\
import rclpy
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Imu
assert deserialize_message(serialize_message(Imu()), Imu) == Imu()
import diagnostic_msgs.msg, geometry_msgs.msg, nav_msgs.msg, rosgraph_msgs.msg, std_msgs.msg
import std_srvs.srv, visualization_msgs.msg
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `earthmoving check`."""
    parser.add_argument(
        "--output",
        type=Path,
        default=Path("out"),
        metavar="DIR",
        help="folder that runs will write to (default: %(default)s)",
    )


def run(args: argparse.Namespace) -> int:
    """Print every check as it is done; 1 if something required is missing, else 0."""
    counts = dict.fromkeys(Status, 0)
    for result in all_checks(args.output):
        print(result, flush=True)
        counts[result.status] += 1
    missing, warnings = counts[Status.MISSING], counts[Status.WARNING]
    if missing:
        print(
            f"\n{missing} to mend before the simulation can run; follow the → lines from the top."
        )
        return 1
    print("\nReady." if not warnings else f"\nReady, with {warnings} thing(s) to know (!).")
    return 0


def all_checks(output: Path) -> Iterator[CheckResult]:
    """Every check, in the order in which to mend what is wrong."""
    yield check_python()
    for dependency in DEPENDENCIES:
        yield check_dependency(dependency)
    yield check_ros()
    yield check_config()
    yield check_output(output)
    yield check_shared_memory()
    yield check_cores()
    yield check_memory()


def check_python() -> CheckResult:
    """The running Python is in the supported range."""
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
    """The package is installed, and its probe runs."""
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


def check_ros() -> CheckResult:
    """Exactly one rclpy can be imported, it is Jazzy's, and its messages work."""
    copies = rclpy_copies()
    if not copies:
        return CheckResult(
            "rclpy",
            Status.MISSING,
            "no ROS 2",
            "`make setup` installs it as wheels. To use a ROS 2 that you have instead, first "
            f"`source /opt/ros/{ROS_DISTRO}/setup.bash`.",
        )
    if len(copies) > 1:
        return CheckResult(
            "rclpy",
            Status.MISSING,
            "two on the path: " + ", ".join(map(str, copies)),
            "They must not mix. To keep the sourced ROS: `make distclean setup` in this terminal. "
            "To keep the wheels: use a terminal in which no ROS is sourced.",
        )
    origin, distro = _ros_origin(copies[0])
    if distro != ROS_DISTRO:
        return CheckResult(
            "rclpy",
            Status.MISSING,
            f"{origin}, of ROS 2 {distro}",
            f"Needs ROS 2 {ROS_DISTRO.title()}: source it, or none, then `make distclean setup`.",
        )
    problem = probe(RCLPY_PROBE)
    if problem is None:
        return CheckResult("rclpy", Status.OK, f"ROS 2 {distro.title()}, {origin}")
    return CheckResult(
        "rclpy",
        Status.MISSING,
        f"{origin}, but: {problem}",
        "Its messages do not work. If it is sourced: apt install ros-jazzy-ros-base. "
        "If it is wheels: `make distclean setup`.",
    )


def rclpy_copies() -> list[Path]:
    """Folders on Python's path that hold an rclpy; more than one means two ROS are mixed."""
    folders = (Path(entry).resolve() for entry in sys.path if entry)
    return list(
        dict.fromkeys(folder for folder in folders if (folder / "rclpy/__init__.py").is_file())
    )


def _ros_origin(folder: Path) -> tuple[str, str]:
    """Where the rclpy in `folder` comes from, in words, and its distribution's name."""
    if not folder.is_relative_to(Path(sys.prefix).resolve()):
        return f"sourced from {folder}", os.environ.get("ROS_DISTRO") or "unknown"
    try:
        return f"wheels {metadata.version(f'ros-{ROS_DISTRO}-rclpy')}", ROS_DISTRO
    except metadata.PackageNotFoundError:
        return f"in {folder}", os.environ.get("ROS_DISTRO") or "unknown"


def check_config() -> CheckResult:
    """The configuration files that come with the package are where it looks for them."""
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
    """Runs can write to `folder`, or create it; nothing is left behind."""
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
        f"A long recording needs more than {_format_bytes(MIN_DISK)}: free some, or write elsewhere.",
    )


def check_shared_memory(folder: Path = Path("/dev/shm")) -> CheckResult:
    """Nodes on one machine can exchange large maps through shared memory."""
    name = "shared memory"
    slower = "Without it nodes fall back to UDP, and large maps may be lost"
    if not (folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)):
        advice = f"{slower}: mount a tmpfs there that this user can write to."
        return CheckResult(name, Status.WARNING, f"{folder} cannot be written", advice)
    usage = shutil.disk_usage(folder)
    return _capacity_check(
        name,
        usage.free >= MIN_SHARED_MEMORY,
        f"{folder} ({_format_bytes(usage.free)} free of {_format_bytes(usage.total)})",
        f"{slower}. In a container: `docker run --shm-size=1g`; else remove what fills it, such as "
        "fastrtps_* of processes that were killed.",
    )


def check_cores() -> CheckResult:
    """There are cores enough for the soil and the machines to run side by side."""
    cores = len(os.sched_getaffinity(0))
    return _capacity_check(
        "cores",
        cores >= MIN_CORES,
        f"{cores} to use",
        f"With fewer than {MIN_CORES}, soil and machines take turns: slower than real time.",
    )


def check_memory(meminfo: Path = Path("/proc/meminfo")) -> CheckResult:
    """There is free memory for the nodes; `meminfo` is the kernel's own account."""
    fields = dict(line.split(":", 1) for line in meminfo.read_text().splitlines() if ":" in line)
    available = int(fields["MemAvailable"].split()[0]) * 1024  # the kernel's "kB" is KiB
    return _capacity_check(
        "memory",
        available >= MIN_MEMORY,
        f"{_format_bytes(available)} free",
        f"Less than {_format_bytes(MIN_MEMORY)}: close other programs, or use a smaller map.",
    )


def probe(code: str) -> str | None:
    """What goes wrong, crashes too, if another Python runs `code`; `None` if nothing does."""
    try:
        done = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            errors="replace",
            timeout=PROBE_TIMEOUT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return f"no answer within {PROBE_TIMEOUT_S:.0f} s"
    if done.returncode == 0:
        return None
    if done.returncode < 0:
        return f"crashed with {signal.Signals(-done.returncode).name}"
    lines = done.stderr.strip().splitlines()
    return lines[-1] if lines else f"exit code {done.returncode}"


def _capacity_check(name: str, is_enough: bool, detail: str, advice: str) -> CheckResult:
    """A check of something that can be too small, but never stops a run."""
    if is_enough:
        return CheckResult(name, Status.OK, detail)
    return CheckResult(name, Status.WARNING, detail, advice)


def _format_bytes(count: int) -> str:
    """A number of bytes, to read."""
    return f"{count / 1024**3:.1f} GiB" if count >= 1024**3 else f"{count / MIB:.0f} MiB"
