"""Select the shipped Fast DDS profile: fast discovery, and shared memory for whole maps."""

import os
from pathlib import Path

from msg_bridge.config_files import find_config

__all__ = ["PROFILE_VARIABLE", "use_shipped_profile"]

PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"


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
