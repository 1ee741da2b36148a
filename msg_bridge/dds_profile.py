"""Settings of the middleware: the shipped Fast DDS profiles, and discovery on this host only."""

import os
from pathlib import Path

from msg_bridge.config_files import find_config

__all__ = [
    "LOCALHOST_PROFILE",
    "PROFILE_VARIABLE",
    "keep_discovery_on_this_host",
    "use_shipped_profile",
]

PROFILE_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
"""Environment variable with the path of the profile that Fast DDS reads."""

LOCALHOST_PROFILE = "fastdds_localhost.xml"
"""Configuration file of the profile that limits discovery to this host."""

_RANGE_VARIABLE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
_LOCALHOST_VARIABLE = "ROS_LOCALHOST_ONLY"
"""Deprecated variable of the same choice; 1 overrides `_RANGE_VARIABLE` and static peers."""
_PEERS_VARIABLE = "ROS_STATIC_PEERS"

_profile_in_use: Path | None = None
"""Shipped profile that this process uses; Fast DDS reads only the first one."""


def keep_discovery_on_this_host() -> None:
    """Let this process and its children find nodes on this host only, unless the user has chosen
    another range.

    Call it before `use_shipped_profile()`.
    """
    if not any(name in os.environ for name in (_RANGE_VARIABLE, _LOCALHOST_VARIABLE)):
        os.environ[_RANGE_VARIABLE] = "LOCALHOST"


def use_shipped_profile() -> Path | None:
    """Use a shipped profile in this process and its children, unless the user has chosen another.

    Call it before `rclpy.init()`: a process reads its profile once. It is `config/fastdds.xml`, or
    `config/fastdds_localhost.xml` if the user has limited discovery to this host. The latter
    contains the limit, and the range becomes SYSTEM_DEFAULT: with LOCALHOST, rmw_fastrtps adds the
    shared memory transport, in which a suspended subscriber stalls publishers. With static peers
    the choice of the user stays as it is, because only rmw_fastrtps adds them.

    Other middleware is left alone. So is a process that is limited to this host and has used Fast
    DDS before: it cannot change its profile any more, and stays limited by LOCALHOST. To use no
    profile, set FASTRTPS_DEFAULT_PROFILES_FILE to the empty string. Child processes with another
    middleware or profile must be given the range again.

    Returns:
        The shipped profile; None if the choice was left as it is.

    Raises:
        ConfigError: the shipped profile is missing.
    """
    if PROFILE_VARIABLE in os.environ or not _is_fast_dds():
        return None
    global _profile_in_use
    is_localhost = _is_limited_to_localhost()
    profile = find_config(LOCALHOST_PROFILE if is_localhost else "fastdds.xml").resolve()
    if is_localhost and profile != _profile_in_use and _was_fast_dds_used():
        return None
    _profile_in_use = profile
    if is_localhost:
        os.environ.pop(_LOCALHOST_VARIABLE, None)
        os.environ[_RANGE_VARIABLE] = "SYSTEM_DEFAULT"
    os.environ[PROFILE_VARIABLE] = str(profile)
    return profile


def _is_fast_dds() -> bool:
    """Whether the middleware of this process is Fast DDS."""
    from rclpy.utilities import get_rmw_implementation_identifier  # only nodes load rclpy

    return "fastrtps" in get_rmw_implementation_identifier()


def _was_fast_dds_used() -> bool:
    """Whether this process has participants, or had some: with another shipped profile, or with the
    shared memory transport, of which a thread remains.
    """
    if _profile_in_use is not None:
        return True
    threads = Path("/proc/self/task").glob("*/comm")
    return any(each.read_text().startswith("dds.") for each in threads)


def _is_limited_to_localhost() -> bool:
    """Whether the user has limited discovery to this host, by rcl's rules, without static peers."""
    if os.environ.get(_LOCALHOST_VARIABLE) == "1":
        return True
    return os.environ.get(_RANGE_VARIABLE) == "LOCALHOST" and not os.environ.get(_PEERS_VARIABLE)
