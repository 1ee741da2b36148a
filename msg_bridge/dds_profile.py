"""Settings of the middleware: the shipped Fast DDS profile, and discovery on this host only."""

import os
from pathlib import Path

from msg_bridge.config_files import find_config

__all__ = ["PROFILE_VARIABLE", "keep_discovery_on_this_host", "use_shipped_profile"]

PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"

_RANGE_VARIABLES = ("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY")
"""Variables by which the user chooses the range of discovery."""


def keep_discovery_on_this_host() -> None:
    """Let this process and its children find nodes on this host only, unless the user has chosen
    another range.

    Call it before `rclpy.init()`.
    """
    if not any(name in os.environ for name in _RANGE_VARIABLES):
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"


def use_shipped_profile() -> Path | None:
    """Use `config/fastdds.xml` in this process unless the user has chosen another profile.

    Call it before `rclpy.init()`: a process reads its profile once. Other middleware ignores it. To
    use no profile, set FASTRTPS_DEFAULT_PROFILES_FILE to the empty string.

    Returns:
        The shipped profile, or None if the user has chosen one.

    Raises:
        ConfigError: the shipped profile is missing.
    """
    if PROFILE_VARIABLE in os.environ:
        return None
    profile = find_config("fastdds.xml").resolve()
    os.environ[PROFILE_VARIABLE] = str(profile)
    return profile
