"""Contents of `viewer --help`."""

from __future__ import annotations

from msg_bridge.nodes.node_usage import NodeUsage
from viewer.params import ViewerParams

__all__ = ["USAGE"]

USAGE = NodeUsage(
    "Serve a page that shows the simulation in 3-D and drives its machines; open the printed"
    " address in a browser.",
    parameters={"": ViewerParams},
)
