"""Error class of messages that cannot be decoded or encoded."""

from msg_bridge.contract.errors import ExchangeError

__all__ = ["CodecError"]


class CodecError(ExchangeError):
    """A ROS message cannot be decoded as expected, or a value cannot be encoded.

    `code` is the reason.
    """
