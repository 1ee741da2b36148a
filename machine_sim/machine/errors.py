"""Errors of machines: each message names the key or command and what to change."""

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["MachineError", "ReachError"]


class MachineError(EarthmovingError):
    """A machine description, command or wrench that cannot be used; it changed nothing."""


class ReachError(MachineError):
    """A tool pose that the arm cannot take up."""
