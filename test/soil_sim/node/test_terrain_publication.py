"""When terrain maps are published: large ones less often, and for new subscribers."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from builtin_interfaces.msg import Time

from soil_sim.node.terrain_publication import TerrainPublication

TICK = 0.01


class Publication:
    """A terrain of some size that changes in each tick, and the ticks in which it is published."""

    def __init__(self, num_points: int, map_rate: float = 2.0) -> None:
        self.tick = 0
        self.published: list[int] = []
        self.publishers = SimpleNamespace(num_map_subscriptions=0, terrain=self.publish)
        grid = SimpleNamespace(rows=num_points, cols=num_points)
        self.soil = SimpleNamespace(grid=grid, revision=0)
        params = SimpleNamespace(map_rate=map_rate, tick_period=TICK)
        run = SimpleNamespace(
            endpoint=SimpleNamespace(soil=self.soil), params=params, cut_fill=None
        )
        self.publication = TerrainPublication(self.publishers, run)  # type: ignore[arg-type]
        self.publication._terrain = lambda: None  # type: ignore[assignment, method-assign, return-value]

    def publish(self, *_: Any) -> None:
        self.published.append(self.tick)

    def run(self, num_ticks: int) -> None:
        for _ in range(num_ticks):
            self.tick += 1
            self.soil.revision += 1
            self.publication.update(self.tick, Time())


@pytest.mark.parametrize(("num_points", "interval"), [(65, 50), (513, 50), (1026, 400)])
def test_large_terrains_are_published_less_often(num_points: int, interval: int) -> None:
    terrain = Publication(num_points)
    terrain.run(2 * interval + 1)
    assert terrain.published == [1, 1 + interval, 1 + 2 * interval]


@pytest.mark.parametrize(("num_points", "is_published"), [(513, False), (1026, True)])
def test_large_terrain_is_published_for_a_new_subscriber(
    num_points: int, is_published: bool
) -> None:
    terrain = Publication(num_points)
    terrain.run(10)
    terrain.publishers.num_map_subscriptions = 1
    for _ in range(2):
        terrain.publication.update_for_new_subscribers(Time())
        terrain.soil.revision += 1
    assert terrain.published == ([1, 10] if is_published else [1])
    terrain.soil.revision = 10
    terrain.publishers.num_map_subscriptions = 2
    terrain.publication.update_for_new_subscribers(Time())
    assert len(terrain.published) == len(set(terrain.published)), "it has not changed"
