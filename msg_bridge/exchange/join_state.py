"""The states of a machine in the exchange."""

from enum import Enum

__all__ = ["JoinState"]


class JoinState(Enum):
    """State of a machine in the exchange.

    ::

        OUT -- join --> JOINING -- welcome --> READY -- send --> WAITING -- answer --> READY ...
                                                 '-- send(leave) --> LEAVING -- confirmed --> OUT
    """

    OUT = "out"
    """It takes no part."""
    JOINING = "joining"
    """It has requested to join; welcome, keyframe or backlog are missing."""
    READY = "ready"
    """It can send the next tick."""
    WAITING = "waiting"
    """It can send the next tick after an answer."""
    LEAVING = "leaving"
    """It has sent its last tick, which the soil has not confirmed."""
