"""Terrain of more columns than one map has: nodes receive it as tiles, viewers as a view."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from support.node_scenes import Scene
from support.recorder_scenes import spin_until_recorded
from support.soil_node_scenes import excavating_scene

from msg_bridge.audit import audit_bag
from msg_bridge.bag.reader import BagReader
from msg_bridge.codec import qos
from msg_bridge.codec.point_cloud import from_point_cloud
from msg_bridge.codec.terrain import from_terrain_cloud
from msg_bridge.codec.terrain_tiles import TileRound, num_tiles_of, tile_from_cdr
from msg_bridge.codec.terrain_view import TERRAIN_VIEW
from msg_bridge.codec.tile_assembly import TileAssembly
from msg_bridge.recorder.recorder_node import RecorderNode
from msg_bridge.testing.ros_context import Ros

SITE = {"site.num_points": 520}


class Tiles:
    """A subscriber to tiles."""

    def __init__(self, ros: Ros) -> None:
        self.assembly = TileAssembly()
        self.messages = ros.collect("/terrain/tiles", PointCloud2, qos.TILES)
        self.num_taken = 0
        self.rounds: list[TileRound] = []  # that completed a map

    def take(self) -> TileAssembly:
        for message in self.messages[self.num_taken :]:
            tile = tile_from_cdr(serialize_message(message))
            if self.assembly.add(tile):
                self.rounds.append(tile.round)
        self.num_taken = len(self.messages)
        return self.assembly


def is_current(tiles: Tiles, scene: Scene) -> Callable[[], bool]:
    """Return a condition: the assembled map is the present terrain."""

    def condition() -> bool:
        cells = tiles.take().cells
        soil = scene.soil.run.endpoint.soil
        if cells is None or tiles.assembly.revision != soil.revision:
            return False
        volume, kind, moisture, rut_depth = soil.layers
        for name, layer in (
            ("z", soil.columns.height.astype(np.float32)),
            ("loose_depth", soil.columns.loose_depth.astype(np.float32)),
            ("surface_material", soil.columns.material),
            ("volume_mm3", volume),
            ("soil", kind),
            ("moisture", moisture),
            ("rut_depth", rut_depth),
        ):
            assert np.array_equal(cells[name], layer), name
        return True

    return condition


def test_machine_digs_in_terrain_received_as_tiles(ros: Ros, tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    recorder = ros.add(RecorderNode, parameters={"path": str(bag), "progress": False})
    tiles = Tiles(ros)
    scene = excavating_scene(ros, tmp_path, required_subscribers=["exchange_recorder"], **SITE)
    ros.spin_until(is_current(tiles, scene), what="the changed tiles")
    assert tiles.rounds[0].num_tiles == num_tiles_of((520, 520)) == 81
    partial = [each.num_tiles for each in tiles.rounds if not each.is_full]
    assert partial
    assert max(partial) <= 4, "only tiles that changed"
    late = Tiles(ros)
    ros.spin_until(is_current(late, scene), what="a late subscriber to have all tiles")
    assert late.rounds[0].is_full
    scene.more_ticks(2)
    assert all(ledger.imbalance == 0 for ledger in scene.ledgers)
    spin_until_recorded(ros, recorder, recorder.recording.messages + 1)
    recorder.stop()
    maps = [message for _, _, message in BagReader(bag).messages(["/terrain/map"])]
    first, last = from_terrain_cloud(maps[0]), from_terrain_cloud(maps[-1])
    assert first.keyframe.grid == last.keyframe.grid == scene.soil.run.endpoint.soil.grid
    assert first.volume_mm3.sum() > last.volume_mm3.sum()
    report = audit_bag(bag)
    assert report.passed, str(report)


def test_reset_publishes_the_terrain_of_the_new_run(ros: Ros, tmp_path: Path) -> None:
    scene = excavating_scene(ros, tmp_path, **SITE)
    tiles = Tiles(ros)
    ros.spin_until(is_current(tiles, scene))
    run_id = tiles.assembly.run_id
    assert scene.trigger("/sim/reset").success
    ros.spin_until(lambda: tiles.take().run_id == run_id + 1, what="tiles of the new run")
    assert tiles.assembly.cells is not None
    assert (tiles.assembly.cells["z"] == 0.0).all()
    scene.more_ticks(2)


def test_view_shows_what_its_parameters_say(ros: Ros, tmp_path: Path) -> None:
    views: list[Any] = ros.collect("/terrain/view", PointCloud2, qos.TRANSIENT_LOCAL)
    scene = excavating_scene(ros, tmp_path, **SITE, map_rate=20.0)
    ros.spin_until(lambda: bool(views))
    assert (views[-1].height, views[-1].width) == (174, 174)  # every third row and column
    region = [-8.0, -4.0, 12.0, 4.0]
    parameters = [Parameter("view_region", value=region), Parameter("view_decimation", value=2)]
    assert all(result.successful for result in scene.soil.set_parameters(parameters))
    ros.spin_until(lambda: views[-1].height == 26)
    points = from_point_cloud(views[-1], TERRAIN_VIEW)
    columns = scene.soil.run.endpoint.soil.columns
    grid = scene.soil.run.endpoint.soil.grid
    rows = np.rint((grid.x_first - points["x"]) / grid.cell).astype(int)
    cols = np.rint((grid.y_first - points["y"]) / grid.cell).astype(int)
    ros.spin_until(lambda: bool((from_point_cloud(views[-1], TERRAIN_VIEW)["z"] < -0.1).any()))
    shown = from_point_cloud(views[-1], TERRAIN_VIEW)["z"]
    scene.pause()
    ros.spin_until(
        lambda: np.array_equal(
            from_point_cloud(views[-1], TERRAIN_VIEW)["z"], columns.height[rows, cols].astype("f4")
        )
    )
    assert shown.size == views[-1].height * views[-1].width
