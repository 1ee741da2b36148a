"""Publish a view of the terrain for display: of a region, and with fewer columns."""

from __future__ import annotations

import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from msg_bridge.codec import qos
from msg_bridge.codec.terrain_view import view_slices, view_to_cdr
from msg_bridge.contract import topics
from msg_bridge.contract.topics import MAP_FRAME
from soil_sim.node.soil_run import SoilRun

__all__ = ["ViewPublication"]


class ViewPublication:
    """Publishes a view, if it is subscribed."""

    def __init__(self, node: Node, run: SoilRun) -> None:
        """
        Args:
            node: the soil node.
            run: the run of the soil, which a reset begins again.
        """
        self._run = run
        self._publisher = node.create_publisher(
            PointCloud2, topics.TERRAIN_VIEW, qos.TRANSIENT_LOCAL
        )
        self._last: tuple[object, ...] | None = None  # what the last view shows

    def publish_if_changed(self, stamp: Time) -> None:
        """Publish the view if terrain or parameters have changed, and it is subscribed."""
        params, endpoint = self._run.params, self._run.endpoint
        grid = endpoint.soil.grid
        rows, cols = view_slices(grid, params.view_region, params.view_decimation)
        shown = (endpoint.exchange.run_id, endpoint.soil.revision, rows, cols)
        if shown == self._last or not self._publisher.get_subscription_count():
            return
        self._last = shown
        layers = self._layers(rows, cols)
        self._publisher.publish(view_to_cdr(grid, rows, cols, layers, MAP_FRAME, stamp))

    def _layers(self, rows: slice, cols: slice) -> dict[str, NDArray[np.generic]]:
        """Return the layers of a view, by field; only what it shows is read."""
        columns, cut_fill = self._run.endpoint.soil.columns, self._run.cut_fill
        is_loose = columns.loose[rows, cols] > 0
        layers: dict[str, NDArray[np.generic]] = {
            "z": columns.height[rows, cols],
            "loose_depth": columns.bulk[rows, cols] * columns.metres_per_mm3,
            "surface_material": columns.material[rows, cols],
            "moisture": np.where(
                is_loose, columns.loose_moisture[rows, cols], columns.moisture[rows, cols]
            ),
            "soil": np.where(is_loose, columns.loose_soil[rows, cols], columns.soil[rows, cols]),
            "design_difference": np.full(is_loose.shape, np.nan, dtype=np.float32),
            "rut_depth": columns.rut_volume[rows, cols] * columns.metres_per_mm3,
        }
        if cut_fill is not None:
            layers["design_difference"] = cut_fill.difference[rows, cols]
        return layers
