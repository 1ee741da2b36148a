"""Publishers of the soil node: time, ledger, configuration, grid, cut and fill."""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time
from nav_msgs.msg import MapMetaData
from numpy.typing import NDArray
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Image
from std_msgs.msg import Bool, Float64MultiArray, Int64MultiArray, String

from msg_bridge.codec import qos
from msg_bridge.codec.cut_fill import CutFillState, to_cut_fill_array
from msg_bridge.codec.state_hash import StateHash, to_state_hash_string
from msg_bridge.codec.terrain_images import to_map_info, to_tilt_image
from msg_bridge.codec.tick_headers import message_to_cdr, with_stamp
from msg_bridge.contract import topics
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.topics import MAP_FRAME

__all__ = ["SoilPublishers"]


class SoilPublishers:
    """Publishers of the state of the soil."""

    def __init__(
        self, node: Node, *, design: bool = False, tilt: NDArray[np.float32] | None = None
    ) -> None:
        """
        Args:
            node: node of the publishers.
            design: whether the site has a design.
            tilt: slopes along x and y by which loose soil leans, shape (rows, cols, 2); None
                without such noise.
        """
        self._tilt = tilt
        self._surface_tilt = (
            None
            if tilt is None
            else node.create_publisher(Image, topics.TERRAIN_SURFACE_TILT, qos.TRANSIENT_LOCAL)
        )
        self._clock = node.create_publisher(Clock, topics.CLOCK, qos.STATE)
        self._ledger = node.create_publisher(Int64MultiArray, topics.SOIL_LEDGER, qos.ROWS)
        self._hash = node.create_publisher(String, topics.SOIL_STATE_HASH, qos.STATE)
        self._info = node.create_publisher(MapMetaData, topics.TERRAIN_INFO, qos.TRANSIENT_LOCAL)
        self._cut_fill = (
            node.create_publisher(Float64MultiArray, topics.SOIL_CUT_FILL, qos.TRANSIENT_LOCAL)
            if design
            else None
        )
        self._config = node.create_publisher(String, topics.SIM_CONFIG, qos.TRANSIENT_LOCAL)
        self._paused = node.create_publisher(Bool, topics.SIM_PAUSED, qos.TRANSIENT_LOCAL)

    def tick(self, ledger: Ledger, stamp: Time) -> None:
        """Publish the clock and the ledger of a tick that ended at `stamp`."""
        self._clock.publish(Clock(clock=stamp))
        self._ledger.publish(message_to_cdr(with_stamp(ledger, stamp)))

    def cut_fill(self, state: CutFillState) -> None:
        """Publish the remaining volumes to cut and to fill, if the site has a design."""
        if self._cut_fill is not None:
            self._cut_fill.publish(to_cut_fill_array(state))

    def begin(self, grid: Grid, config: str, stamp: Time) -> None:
        """Publish the configuration [YAML] of a run, and the grid of its terrain."""
        self._config.publish(String(data=config))
        self._info.publish(to_map_info(grid, stamp))
        if self._surface_tilt is not None and self._tilt is not None:
            self._surface_tilt.publish(to_tilt_image(self._tilt, MAP_FRAME, stamp))

    def state_hash(self, state_hash: StateHash) -> None:
        """Publish the hash of the terrain after a tick."""
        self._hash.publish(to_state_hash_string(state_hash))

    def paused(self, paused: bool) -> None:
        """Publish whether time stands still."""
        self._paused.publish(Bool(data=paused))
