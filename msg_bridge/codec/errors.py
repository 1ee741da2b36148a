"""The error of a message that is not what it should be."""

from msg_bridge.contract.errors import ExchangeError

__all__ = ["CodecError"]


class CodecError(ExchangeError):
    """A ROS message cannot be read as what it should be, or a value does not fit into one."""
