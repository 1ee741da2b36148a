"""The error of a command that is refused."""

from msg_bridge.contract.errors import EarthmovingError

__all__ = ["CommandError"]


class CommandError(EarthmovingError):
    """A command that cannot be meant; it changed nothing, and what was commanded before holds."""
