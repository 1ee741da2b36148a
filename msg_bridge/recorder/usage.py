"""Contents of `exchange_recorder --help`."""

from __future__ import annotations

from msg_bridge.nodes.node_usage import NodeUsage
from msg_bridge.recorder.params import RecorderParams

__all__ = ["USAGE"]

USAGE = NodeUsage(
    "Record topics to an MCAP bag, byte by byte, and count lost messages.",
    parameters={"": RecorderParams},
)
