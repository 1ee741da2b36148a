"""Detection of another soil node that publishes the same topics.

Two soil nodes on the same topics mix up two simulations: machines receive the ticks of both. A node
that discovers another publisher before it has created its own is the later one: it ends, and the
run in progress is not disturbed. Of two nodes that start within the discovery time of each other,
neither is known to be the later one, so both report the conflict in their diagnostics and logs.
"""

from __future__ import annotations

import time

from rclpy.node import Node

from msg_bridge.contract import topics
from soil_sim.errors import SoilError

__all__ = ["DuplicateSoilNodeError", "check_no_other_soil_node", "describe_duplicate"]

_POLL_PERIOD = 0.02
"""Wall time between two queries of the ROS graph [s]."""


class DuplicateSoilNodeError(SoilError):
    """Another soil node publishes the same topics."""


def check_no_other_soil_node(node: Node, deadline: float) -> None:
    """Check that nothing else publishes the tick of the soil.

    Call it before the node creates its own publisher. A node that was killed is not found: it
    announces itself no longer to participants that are created after its end.

    Args:
        node: the soil node.
        deadline: monotonic time until which publishers may be discovered [s].

    Raises:
        DuplicateSoilNodeError: there is another publisher.
    """
    while True:
        if node.count_publishers(topics.SOIL_TICK):
            raise DuplicateSoilNodeError(f"{describe_duplicate(node)}; this node ends")
        if time.monotonic() >= deadline:
            return
        time.sleep(_POLL_PERIOD)


def describe_duplicate(node: Node) -> str:
    """Return a sentence on another soil node, with the change to make."""
    topic = node.resolve_topic_name(topics.SOIL_TICK)
    return f"another soil node publishes {topic}; give each its own namespace or ROS_DOMAIN_ID"
