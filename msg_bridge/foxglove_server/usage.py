"""Contents of `foxglove_server --help`."""

from __future__ import annotations

from msg_bridge.foxglove_server.params import FoxgloveServerParams
from msg_bridge.nodes.node_usage import NodeUsage

__all__ = ["USAGE"]

USAGE = NodeUsage(
    "Serve all topics live to Foxglove and Lichtblick; open the printed address there as a"
    " Foxglove WebSocket connection.",
    parameters={"": FoxgloveServerParams},
)
