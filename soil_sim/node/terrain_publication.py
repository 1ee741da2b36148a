"""What is published of the terrain, and when.

Terrain of up to MAX_MAP_CELLS columns is published as one map, which every tool understands. The
map of a larger one would take longer to build and to send than a tick: it is published as tiles.
A view for display, and the volumes of a design, are published of both.
"""

from __future__ import annotations

from builtin_interfaces.msg import Time
from rclpy.node import Node

from msg_bridge.codec.cut_fill import CutFillState
from msg_bridge.codec.terrain import TerrainMap
from msg_bridge.contract.constants import MAX_MAP_CELLS
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.rows import Rows
from soil_sim.node.map_publication import MapPublication
from soil_sim.node.soil_publishers import SoilPublishers
from soil_sim.node.soil_run import SoilRun
from soil_sim.node.tile_publication import TilePublication
from soil_sim.node.view_publication import ViewPublication

__all__ = ["TerrainPublication"]


class TerrainPublication:
    """Publishes the terrain of a run with all its layers."""

    def __init__(self, node: Node, publishers: SoilPublishers, run: SoilRun) -> None:
        """
        Args:
            node: the soil node.
            publishers: its publishers of other topics.
            run: the run of the soil, which a reset begins again.
        """
        self._publishers, self._run = publishers, run
        grid = run.endpoint.soil.grid
        is_large = grid.rows * grid.cols > MAX_MAP_CELLS
        self._surface = (TilePublication if is_large else MapPublication)(node, run, self._terrain)
        self._view = ViewPublication(node, run)
        self._next_tick, self._revision = 0, -1  # the revision is that of the published volumes

    def begin(self, stamp: Time) -> None:
        """Publish the terrain with which a run begins, or continues."""
        self._next_tick, self._revision = 0, self._run.endpoint.soil.revision
        self._surface.begin(stamp)
        self._view.publish_if_changed(stamp)
        self._publish_cut_fill()

    def update(self, tick: int, map_updates: Rows, stamp: Time) -> None:
        """Publish the terrain after a tick, if it is due.

        Args:
            tick: number of the tick.
            map_updates: its MAP_UPDATE rows.
            stamp: its end.
        """
        self._surface.record_tick(map_updates, stamp)
        if tick >= self._next_tick:
            params = self._run.params
            self._next_tick = tick + max(1, round(1.0 / (params.map_rate * params.tick_period)))
            self.publish_if_changed(stamp)

    def update_for_new_subscribers(self, stamp: Time) -> None:
        """Publish what a new subscriber does not receive otherwise."""
        self._surface.update_for_new_subscribers(stamp)
        self._view.publish_if_changed(stamp)

    def publish_if_changed(self, stamp: Time) -> None:
        """Publish the terrain if it has changed since it was published."""
        self._surface.publish_if_changed(stamp)
        self._view.publish_if_changed(stamp)
        revision = self._run.endpoint.soil.revision
        if revision != self._revision:
            self._revision = revision
            self._publish_cut_fill()

    def send_all(self, stamp: Time) -> None:
        """Publish all of the present terrain, for a machine that joins."""
        self._surface.send_all(stamp)

    def _publish_cut_fill(self) -> None:
        now = self._run.cut_fill
        if now is not None:
            seconds = max(self._run.tick, 0) * self._run.params.tick_period
            volumes = (now.cut, now.fill, now.remaining, now.within_tolerance)
            self._publishers.cut_fill(CutFillState(seconds, *volumes))

    def _terrain(self) -> TerrainMap:
        """Return the present terrain with all layers."""
        soil, run_id = self._run.endpoint.soil, self._run.endpoint.exchange.run_id
        columns, cut_fill = soil.columns, self._run.cut_fill
        keyframe = Keyframe(run_id, soil.revision, soil.grid, columns.height, *soil.layers)
        layers = {} if cut_fill is None else {"design_difference": cut_fill.difference}
        return TerrainMap(keyframe, columns.loose_depth, columns.material, **layers)
