"""When the terrain is published: at the begin of a run, and if it has changed, at a rate.

The map of a large terrain is a large message, which takes longer to build and to send than a tick.
It is published less often, and again when there is a new subscriber, which needs a map that is
newer than its first map update.
"""

from __future__ import annotations

from builtin_interfaces.msg import Time

from msg_bridge.codec.cut_fill import CutFillState
from msg_bridge.codec.terrain import TerrainMap
from msg_bridge.contract.messages import Keyframe
from soil_sim.node.soil_publishers import SoilPublishers
from soil_sim.node.soil_run import SoilRun

__all__ = ["TerrainPublication"]

_MAX_CELLS_AT_FULL_RATE = 513 * 513
"""Number of cells above which terrain maps are published less often."""

_RATE_EXPONENT = 1.5
"""Exponent of the number of cells by which the rate decreases above that."""


class TerrainPublication:
    """Publishes the terrain of a run with all its layers."""

    def __init__(self, publishers: SoilPublishers, run: SoilRun) -> None:
        """
        Args:
            publishers: publishers of the node.
            run: the run of the soil, which a reset begins again.
        """
        self._publishers, self._run = publishers, run
        self._next_tick = self._revision = 0
        self._num_subscriptions = 0

    def begin(self, config: str, stamp: Time) -> None:
        """Publish the configuration [YAML] of a run and its present terrain."""
        self._next_tick = 0
        self._revision = self._run.endpoint.soil.revision
        self._publishers.begin(self._terrain(), config, stamp)
        self._publish_cut_fill()

    def update(self, tick: int, stamp: Time) -> None:
        """Publish the terrain after a tick, if it is due."""
        if tick >= self._next_tick:
            self._next_tick = tick + self._interval_in_ticks
            self.publish_if_changed(stamp)

    def update_for_new_subscribers(self, stamp: Time) -> None:
        """Publish a terrain that is rarely published, if there is a new subscriber to it."""
        before, now = self._num_subscriptions, self._publishers.num_map_subscriptions
        self._num_subscriptions = now
        if now > before and self._size_ratio > 1.0:
            self.publish_if_changed(stamp)

    def publish_if_changed(self, stamp: Time) -> None:
        """Publish the terrain if it has changed since it was published."""
        revision = self._run.endpoint.soil.revision
        if revision != self._revision:
            self._revision = revision
            self._publishers.terrain(self._terrain(), stamp)
            self._publish_cut_fill()

    def send_keyframe(self, keyframe: Keyframe, stamp: Time) -> None:
        """Publish the present terrain for a machine that joins."""
        self._publishers.terrain(self._with_layers(keyframe), stamp)

    @property
    def _interval_in_ticks(self) -> int:
        """Minimum number of ticks between two maps; more for large terrains."""
        params = self._run.params
        rate = params.map_rate / max(1.0, self._size_ratio) ** _RATE_EXPONENT
        return max(1, int(round(1.0 / (rate * params.tick_period))))

    @property
    def _size_ratio(self) -> float:
        """Number of cells over that of the largest terrain that is published at the full rate."""
        grid = self._run.endpoint.soil.grid
        return grid.rows * grid.cols / _MAX_CELLS_AT_FULL_RATE

    def _publish_cut_fill(self) -> None:
        now = self._run.cut_fill
        if now is not None:
            seconds = max(self._run.tick, 0) * self._run.params.tick_period
            self._publishers.cut_fill(
                CutFillState(seconds, now.cut, now.fill, now.remaining, now.within_tolerance)
            )

    def _terrain(self) -> TerrainMap:
        soil, run_id = self._run.endpoint.soil, self._run.endpoint.exchange.run_id
        surface = (soil.grid, soil.columns.height, *soil.layers)
        return self._with_layers(Keyframe(run_id, soil.revision, *surface))

    def _with_layers(self, keyframe: Keyframe) -> TerrainMap:
        """Add the layers of the columns, which have not changed since the keyframe was made."""
        columns, cut_fill = self._run.endpoint.soil.columns, self._run.cut_fill
        layers = {} if cut_fill is None else {"design_difference": cut_fill.difference}
        return TerrainMap(keyframe, columns.loose_depth, columns.material, **layers)
