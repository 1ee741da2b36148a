"""Quality of service of each kind of topic, by name.

The one module here that needs rclpy. A profile is what this package's publishers offer and its
subscribers ask for; since all publishers are reliable, any subscriber of yours matches them.
"""

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

__all__ = ["COMMANDS", "ROWS", "STATE", "TRANSIENT_LOCAL"]


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
"""Rows, tick headers, requests, refusals, the ledger. Keep-last, so that no slow subscriber blocks
a writer; what is lost is asked for again."""

TRANSIENT_LOCAL = _keep_last(1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""What a late subscriber needs the latest of: terrain map, elevation, info, robot description,
configuration."""

STATE = _keep_last(10)
"""Streams of which the newest counts: clock, joint states, odometry, wrench, particles; and the
emergency stop, which must not be lost."""

COMMANDS = _keep_last(10, reliability=ReliabilityPolicy.BEST_EFFORT)
"""For subscriptions to streams of commands: any publisher matches, and a lost one is soon
renewed."""
