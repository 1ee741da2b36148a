"""Detection of another node that publishes the topics of a node that starts.

Two soil nodes on the same topics mix up two simulations, and two machine nodes in one namespace
publish each other's states. A node that discovers another publisher before it has created its own
is the later one: it ends, and the run in progress is not disturbed. Of two nodes that start within
the discovery time of each other, neither is known to be the later one, so both report the conflict
in their diagnostics and logs (`endpoint_monitor`).
"""

from __future__ import annotations

import time
from collections.abc import Sequence

from rclpy.node import Node

from msg_bridge.contract.errors import EarthmovingError
from msg_bridge.nodes.endpoint_monitor import UNKNOWN_NODE, node_name

__all__ = ["DuplicateNodeError", "check_no_other_node"]

_POLL_PERIOD = 0.02
"""Wall time between two queries of the ROS graph [s]."""


class DuplicateNodeError(EarthmovingError):
    """Another node publishes the same topics."""


def check_no_other_node(node: Node, names: Sequence[str], deadline: float, *, remedy: str) -> None:
    """Check that nothing else publishes some topics of a node.

    Call it before the node creates its own publishers. A node that was killed is not found: it
    announces itself no longer to participants that are created after its end.

    Args:
        node: the node that starts.
        names: names of the topics, as the node uses them.
        deadline: monotonic time until which publishers may be discovered [s].
        remedy: what to change, for the error message.

    Raises:
        DuplicateNodeError: there is another publisher.
    """
    topics = [node.resolve_topic_name(name) for name in names]
    while True:
        is_late = time.monotonic() >= deadline
        for topic in topics:
            if not node.count_publishers(topic):
                continue
            infos = node.get_publishers_info_by_topic(topic)
            others = set(map(node_name, infos))
            if others and (is_late or UNKNOWN_NODE not in others):
                raise DuplicateNodeError(
                    f"another node, {' and '.join(sorted(others))}, publishes {topic}; {remedy};"
                    " this node ends"
                )
        if is_late:
            return
        time.sleep(_POLL_PERIOD)
