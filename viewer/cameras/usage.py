"""Contents of `camera --help`."""

from __future__ import annotations

from msg_bridge.nodes.node_usage import NodeUsage
from viewer.cameras.params import CameraParams

__all__ = ["USAGE"]

USAGE = NodeUsage(
    "Publish images of cameras on machines, drawn by the live page in a Chromium without a window.",
    parameters={"": CameraParams},
)
