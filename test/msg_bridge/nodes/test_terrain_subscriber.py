"""The terrain as any node can follow it, beside a soil that is dug."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Int64MultiArray
from support.node_scenes import TICK, Scene, dig, machine_file, ready_to_dig

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
    """A node that follows the terrain."""

    def __init__(self, **kwargs: object) -> None:
        super().__init__("viewer", **kwargs)
        self.refused: list[tuple[str, str]] = []
        self.resynced = 0
        self.ticks: list[int] = []
        poller = SubscriptionPoller(self, self.note)
        self.listener = TerrainSubscriber(
            self,
            poller,
            lambda *what: self.refused.append(what),
            self.resync,
            simulation_namespace="/",
        )
        self.follower = self.listener.follower
        # What wakes it in every tick.
        poller.subscribe(Int64MultiArray, "/soil/ledger", qos.ROWS, lambda message: None)

    def note(self) -> None:
        self.ticks.append(self.follower.tick)

    def resync(self) -> None:
        self.resynced += 1


def same(viewer: Viewer, scene: Scene) -> bool:
    """Whether it shows the soil's surface as it is."""
    soil, follower = scene.soil.run.endpoint.soil, viewer.follower
    if (follower.tick, follower.revision) != (scene.tick, soil.revision):
        return False
    return bool((follower.elevation == soil.columns.height.astype(np.float32)).all())


def waker(ros: Ros) -> Callable[[], None]:
    """Publishes what wakes a viewer."""
    ledgers = ros.publisher("/soil/ledger", Int64MultiArray, subscriptions=1)
    return lambda: ledgers.publish(Int64MultiArray())


@pytest.fixture
def digging(ros: Ros, tmp_path: Path) -> Scene:
    """A scene whose soil is being dug."""
    scene = Scene(ros)
    options = {"commands.command_timeout": 60.0, "machine": machine_file(tmp_path, ready_to_dig())}
    machine = scene.machine(**options)
    dig(scene, machine, lambda ledger: ledger.particles > 10**7)
    return scene


def test_the_terrain_is_followed_tick_by_tick_from_the_beginning(ros: Ros, tmp_path: Path) -> None:
    viewer = ros.add(Viewer)
    scene = Scene(ros)
    options = {"commands.command_timeout": 60.0, "machine": machine_file(tmp_path, ready_to_dig())}
    dig(scene, scene.machine(**options), lambda ledger: ledger.particles > 10**7)
    scene.pause()
    ros.spin_until(lambda: same(viewer, scene))
    assert viewer.follower.revision > 5
    assert viewer.follower.gaps == viewer.resynced == 0
    assert viewer.ticks == sorted(viewer.ticks)
    assert viewer.refused == []


def test_who_comes_late_sees_the_same(ros: Ros, digging: Scene) -> None:
    viewer = ros.add(Viewer)
    digging.more_ticks(5)
    digging.pause()
    ros.spin_until(lambda: same(viewer, digging))
    assert viewer.follower.elevation.min() < -0.05


def test_who_comes_while_time_stands_still_sees_it_too(ros: Ros, digging: Scene) -> None:
    digging.pause()
    viewer = ros.add(Viewer)
    ros.spin_until(lambda: same(viewer, digging))


def test_a_reset_is_followed(ros: Ros, digging: Scene) -> None:
    viewer = ros.add(Viewer)
    digging.more_ticks(3)
    digging.trigger("/sim/reset")
    run_id = digging.soil.run.endpoint.exchange.run_id
    digging.until_tick(3)
    digging.pause()
    ros.spin_until(lambda: same(viewer, digging))
    assert viewer.follower.run_id == run_id
    assert viewer.follower.elevation.min() == 0.0


def test_messages_that_cannot_be_read_are_refused_and_change_nothing(ros: Ros) -> None:
    viewer = ros.add(Viewer)
    wake = waker(ros)
    tick = ros.publisher("/soil/tick", Int64MultiArray, subscriptions=1)
    changes = ros.publisher("/terrain/map_updates", PointCloud2, subscriptions=1)
    terrain = ros.publisher("/terrain/map", PointCloud2, qos.TRANSIENT_LOCAL, subscriptions=1)
    tick.publish(Int64MultiArray(data=[9, 9, 9]))
    tick.publish(to_multi_array(Ledger(1, 1, 0, 0, 0, 0, 0, 0, 0)))
    changes.publish(PointCloud2())
    terrain.publish(PointCloud2())
    ros.spin_until(lambda: wake() or len(viewer.refused) == 4)
    topics = sorted(topic for topic, _ in viewer.refused)
    assert topics == ["/soil/tick", "/soil/tick", "/terrain/map", "/terrain/map_updates"]
    assert viewer.follower.grid is None


def test_after_a_stall_a_keyframe_is_taken_for_what_is_missing(ros: Ros) -> None:
    viewer = ros.add(Viewer)
    wake = waker(ros)
    tick = ros.publisher("/soil/tick", Int64MultiArray, subscriptions=1)
    terrain = ros.publisher("/terrain/map", PointCloud2, qos.TRANSIENT_LOCAL, subscriptions=1)
    none = RowRange()

    def keyframe(revision: int, height: float) -> PointCloud2:
        frame = Keyframe(1, revision, GRID, np.full(GRID.shape, height))
        layers = TerrainMap(frame, np.zeros(GRID.shape))
        return to_terrain_cloud(layers, "map", stamp_from_tick(0, TICK))

    terrain.publish(keyframe(0, 0.0))
    ros.spin_until(lambda: wake() or viewer.follower.grid is not None)
    header = SoilHeader(1, 1, 1, none, RowRange(1, 3), none, ())  # its rows never come
    tick.publish(to_multi_array(header))
    terrain.publish(keyframe(1, 0.5))
    ros.spin_until(lambda: wake() or viewer.resynced == 1)
    assert (viewer.follower.tick, viewer.follower.revision) == (1, 1)
    assert (viewer.follower.elevation == 0.5).all()
