"""Names of the levels of `diagnostic_msgs/DiagnosticStatus`."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus

__all__ = ["level_name"]

_LEVELS = ("OK", "WARN", "ERROR", "STALE")


def level_name(status: DiagnosticStatus) -> str:
    """Return the name of the level of a status; STALE for an unknown one."""
    return _LEVELS[min(int(status.level[0]), len(_LEVELS) - 1)]
