"""The error of a rejected command."""

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["CommandError"]


class CommandError(EarthmovingError):
    """Raised for an invalid command; the commands in force stay unchanged."""
