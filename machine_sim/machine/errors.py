"""Errors of machines; each message names the key or command and what to change."""

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["MachineError", "ReachError"]


class MachineError(EarthmovingError):
    """A machine specification, command or wrench is invalid; the machine is unchanged."""


class ReachError(MachineError):
    """A tool pose is outside the workspace of the arm."""
