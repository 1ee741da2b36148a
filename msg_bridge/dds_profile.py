"""Makes Fast DDS find other nodes at once and carry whole maps, by the shipped profile."""

import os
from pathlib import Path

from msg_bridge.config_files import find_config

__all__ = ["PROFILE_VARIABLE", "use_shipped_profile"]

PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"


def use_shipped_profile() -> Path | None:
    """Let this process use `config/fastdds.xml`, unless the user has chosen another profile.

    To be called before the first node is made, best before `rclpy.init()`: a process reads its
    profile once. Other middleware than Fast DDS does not look at it. To have no profile at all, a
    user sets FASTRTPS_DEFAULT_PROFILES_FILE to the empty string.

    Returns:
        The shipped profile, or `None` if the user has chosen.

    Raises:
        ConfigError: the shipped profile is missing.
    """
    if PROFILE_VARIABLE in os.environ:
        return None
    profile = find_config("fastdds.xml").resolve()
    os.environ[PROFILE_VARIABLE] = str(profile)
    return profile
