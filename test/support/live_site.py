"""LiveSite: soil, excavator and viewer as processes, as a user starts them."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState, PointCloud2

from msg_bridge.codec import qos
from msg_bridge.codec.stamps import seconds_from_stamp
from msg_bridge.codec.terrain import cells_of_terrain_cloud, keyframe_of_cells
from msg_bridge.codec.terrain_tiles import tile_from_cdr
from msg_bridge.codec.tile_assembly import TileAssembly
from msg_bridge.testing.fixtures import StartProcess
from msg_bridge.testing.ros_context import Ros
from msg_bridge.testing.ros_process import RosProcess
from support.live_page import LOADED, LivePage

__all__ = ["LiveSite"]


class LiveSite:
    """Nodes in real time, and the topics that tests compare the page with.

    Attributes:
        ros: nodes and topics of the test.
        soil, machine, viewer: the processes.
        url: address of the page.
    """

    def __init__(
        self,
        ros: Ros,
        start: StartProcess,
        *,
        soil: dict[str, Any] | None = None,
        machine: dict[str, Any] | None = None,
    ) -> None:
        """
        Args:
            ros: nodes and topics of the test.
            start: fixture `ros_process`.
            soil, machine: parameters of the nodes.
        """
        self.ros = ros
        self._start = start
        self._maps = ros.collect("/terrain/map", PointCloud2, qos.TRANSIENT_LOCAL)
        self._tiles = ros.collect("/terrain/tiles", PointCloud2, qos.TILES)  # of a large site
        self._assembly = TileAssembly()
        self._states = ros.collect("/excavator/joint_states", JointState)
        site = {"site.terrain": "rough", "site.num_points": 129, "site.cell": 0.2}
        self.soil = start(
            [sys.executable, "-m", "soil_sim.node.soil_node"], parameters={**site, **(soil or {})}
        )
        self.machine = start(
            [sys.executable, "-m", "machine_sim.node.machine_node"],
            parameters=machine or {},
            namespace="/excavator",
        )
        self.viewer = self.start_viewer(0)

    def start_viewer(self, port: int) -> RosProcess:
        """Start a viewer and wait until it serves its page."""
        viewer = self._start([sys.executable, "-m", "viewer.node"], parameters={"port": port})
        self.url = viewer.wait_for_output(r"http://localhost:\d+/").group()
        return viewer

    @property
    def port(self) -> int:
        """Port of the page."""
        return int(self.url.rstrip("/").rpartition(":")[2])

    def spin(self) -> None:
        """Receive what has arrived."""
        self.ros.spin_for(0.05)

    def elevation(self) -> NDArray[np.float32]:
        """Return the newest elevation on `/terrain/map` [m], shape (rows, cols)."""
        self.ros.spin_until(lambda: self._maps or self._assemble())
        del self._maps[:-1]
        cells = self._assembly.cells
        if cells is None:
            cells = cells_of_terrain_cloud(self._maps[-1])
        return keyframe_of_cells(cells).elevation.astype(np.float32)

    def _assemble(self) -> bool:
        """Assemble the tiles that were received; return whether there is a map."""
        for tile in self._tiles:
            self._assembly.add(tile_from_cdr(serialize_message(tile)))
        self._tiles.clear()
        return self._assembly.cells is not None

    def wait_for_terrain(self, page: LivePage) -> None:
        """Wait until a page's texture has the elevations of the newest map."""

        def agrees() -> bool:
            expected = self.elevation()
            is_ready = bool(page.state().get("ready"))
            return is_ready and np.array_equal(page.heights(0, 0, *expected.shape), expected)

        page.wait_until(agrees, self.spin, LOADED)

    def sim_time(self) -> float:
        """Return the simulation time of the newest joint state [s]."""
        self.joints()
        return seconds_from_stamp(self._states[-1].header.stamp)

    @property
    def swing_velocity(self) -> float:
        """Newest velocity of the swing, positive to the left [rad/s]; it has no limit of angle."""
        return self.joints()["swing"][1]

    def joints(self) -> dict[str, tuple[float, float]]:
        """Return the newest angle [rad] and velocity [rad/s] of each joint."""
        self.ros.spin_until(lambda: self._states)
        del self._states[:-1]
        state = self._states[-1]
        return dict(zip(state.name, zip(state.position, state.velocity, strict=True), strict=True))
