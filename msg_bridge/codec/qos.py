"""QoS profiles of the kinds of topics.

Only this module of the package needs rclpy. Publishers offer and subscribers request the same
profile. All publishers are reliable, so subscribers of any reliability match them.
"""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

__all__ = ["COMMANDS", "ROWS", "SERVICES", "STATE", "TILES", "TRANSIENT_LOCAL"]


def _keep_last(
    depth: int,
    reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE,
    durability: DurabilityPolicy = DurabilityPolicy.VOLATILE,
) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=reliability,
        durability=durability,
    )


ROWS = _keep_last(256)
"""Rows, tick headers, requests, rejections, the ledger; transforms, one message per link at once.
Keep-last, so that a slow subscriber cannot block a publisher; lost messages are requested again."""

TILES = _keep_last(512)
"""Tiles of large terrain, of 280 kB each; a round of which one was lost is followed by another."""

TRANSIENT_LOCAL = _keep_last(1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""State of which a late subscriber needs the latest message: terrain map, elevation, map info,
robot description, configuration."""

STATE = _keep_last(10)
"""Streams of states: clock, joint states, odometry, wrench, particles; and the emergency stop,
which must not be lost."""

COMMANDS = _keep_last(10, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Subscriptions to streams of commands: publishers of any reliability match, and a lost command is
soon replaced by the next."""

SERVICES = _keep_last(4096)
"""Servers of services: requests that arrive while one is served must all wait, and the responses of
a burst must all be kept until they are acknowledged. Clients have the default profile."""
