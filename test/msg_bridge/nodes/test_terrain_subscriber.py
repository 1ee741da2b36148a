"""Any node can follow the terrain while soil is excavated."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Int64MultiArray
from support.node_scenes import TICK, Scene, dig, machine_file, ready_to_dig
from support.soil_node_scenes import excavating_scene

from msg_bridge.codec import qos
from msg_bridge.codec.stamps import stamp_from_tick
from msg_bridge.codec.terrain import TerrainMap, to_terrain_cloud
from msg_bridge.codec.tick_headers import to_multi_array
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.ledger import Ledger
from msg_bridge.contract.messages import Keyframe, RowRange, SoilHeader
from msg_bridge.nodes.subscription_poller import SubscriptionPoller
from msg_bridge.nodes.terrain_subscriber import TerrainSubscriber
from msg_bridge.testing.ros_context import Ros

GRID = Grid(4, 4, 1.0)


class Viewer(Node):
    """Node that follows the terrain."""

    def __init__(self, **kwargs: object) -> None:
        super().__init__("viewer", **kwargs)
        self.rejections: list[tuple[str, str]] = []
        self.num_resyncs = 0
        self.ticks: list[int] = []
        poller = SubscriptionPoller(self, self.append_tick)
        self.listener = TerrainSubscriber(
            self,
            poller,
            lambda *rejection: self.rejections.append(rejection),
            self.resync,
            simulation_namespace="/",
        )
        self.follower = self.listener.follower
        # Triggers the poller in every tick.
        poller.subscribe(Int64MultiArray, "/soil/ledger", qos.ROWS, lambda message: None)

    def append_tick(self) -> None:
        self.ticks.append(self.follower.tick)

    def resync(self) -> None:
        self.num_resyncs += 1


def is_current(viewer: Viewer, scene: Scene) -> bool:
    """Return whether a viewer has the current surface of the soil."""
    soil, follower = scene.soil.run.endpoint.soil, viewer.follower
    if (follower.tick, follower.revision) != (scene.tick, soil.revision):
        return False
    return bool((follower.elevation == soil.columns.height.astype(np.float32)).all())


def make_trigger(ros: Ros) -> Callable[[], None]:
    """Return a function that publishes a message that triggers the viewer's poller."""
    ledgers = ros.publisher("/soil/ledger", Int64MultiArray, subscriptions=1)
    return lambda: ledgers.publish(Int64MultiArray())


@pytest.fixture
def digging(request: pytest.FixtureRequest, ros: Ros, tmp_path: Path) -> Scene:
    """Return a scene whose machine is excavating soil, on a site of some size."""
    size = getattr(request, "param", None)
    return excavating_scene(ros, tmp_path, **({} if size is None else {"site.num_points": size}))


of_both_sizes = pytest.mark.parametrize("digging", [65, 520], indirect=True)
"""Terrain that is published as a map, and as tiles."""


def test_terrain_is_followed_from_the_first_tick(ros: Ros, tmp_path: Path) -> None:
    viewer = ros.add(Viewer)
    scene = Scene(ros)
    options = {"commands.command_timeout": 60.0, "machine": machine_file(tmp_path, ready_to_dig())}
    dig(scene, scene.machine(**options), lambda ledger: ledger.particles > 10**7)
    scene.pause()
    ros.spin_until(lambda: is_current(viewer, scene))
    assert viewer.follower.revision > 5
    assert viewer.follower.gaps == viewer.num_resyncs == 0
    assert viewer.ticks == sorted(viewer.ticks)
    assert viewer.rejections == []


@of_both_sizes
def test_late_subscriber_has_the_current_terrain(ros: Ros, digging: Scene) -> None:
    viewer = ros.add(Viewer)
    digging.more_ticks(5)
    digging.pause()
    ros.spin_until(lambda: is_current(viewer, digging))
    assert viewer.follower.elevation.min() < -0.05


@of_both_sizes
def test_late_subscriber_has_the_current_terrain_while_paused(ros: Ros, digging: Scene) -> None:
    digging.pause()
    viewer = ros.add(Viewer)
    ros.spin_until(lambda: is_current(viewer, digging))


@of_both_sizes
def test_reset_is_followed(ros: Ros, digging: Scene) -> None:
    viewer = ros.add(Viewer)
    digging.more_ticks(3)
    digging.trigger("/sim/reset")
    run_id = digging.soil.run.endpoint.exchange.run_id
    digging.until_tick(3)
    digging.pause()
    ros.spin_until(lambda: is_current(viewer, digging))
    assert viewer.follower.run_id == run_id
    assert viewer.follower.elevation.min() == 0.0


def test_malformed_messages_are_rejected_and_change_nothing(ros: Ros) -> None:
    viewer = ros.add(Viewer)
    trigger = make_trigger(ros)
    tick = ros.publisher("/soil/tick", Int64MultiArray, subscriptions=1)
    changes = ros.publisher("/terrain/map_updates", PointCloud2, subscriptions=1)
    terrain = ros.publisher("/terrain/map", PointCloud2, qos.TRANSIENT_LOCAL, subscriptions=1)
    tick.publish(Int64MultiArray(data=[9, 9, 9]))
    tick.publish(to_multi_array(Ledger(1, 1, 0, 0, 0, 0, 0, 0, 0)))
    changes.publish(PointCloud2())
    terrain.publish(PointCloud2())
    ros.spin_until(lambda: trigger() or len(viewer.rejections) == 4)
    topics = sorted(topic for topic, _ in viewer.rejections)
    assert topics == ["/soil/tick", "/soil/tick", "/terrain/map", "/terrain/map_updates"]
    assert viewer.follower.grid is None


def test_keyframe_replaces_missing_rows_after_a_stall_while_simulation_time_stands_still(
    ros: Ros,
) -> None:
    viewer = ros.add(Viewer, parameters={"use_sim_time": True})
    trigger = make_trigger(ros)
    tick = ros.publisher("/soil/tick", Int64MultiArray, subscriptions=1)
    terrain = ros.publisher("/terrain/map", PointCloud2, qos.TRANSIENT_LOCAL, subscriptions=1)
    none = RowRange()

    def keyframe(revision: int, height: float) -> PointCloud2:
        frame = Keyframe(1, revision, GRID, np.full(GRID.shape, height))
        layers = TerrainMap(frame, np.zeros(GRID.shape))
        return to_terrain_cloud(layers, "map", stamp_from_tick(0, TICK))

    terrain.publish(keyframe(0, 0.0))
    ros.spin_until(lambda: trigger() or viewer.follower.grid is not None)
    header = SoilHeader(1, 1, 1, none, RowRange(1, 3), none, ())  # its rows are never sent
    tick.publish(to_multi_array(header))
    terrain.publish(keyframe(1, 0.5))
    ros.spin_until(lambda: trigger() or viewer.num_resyncs == 1)
    assert (viewer.follower.tick, viewer.follower.revision) == (1, 1)
    assert (viewer.follower.elevation == 0.5).all()
