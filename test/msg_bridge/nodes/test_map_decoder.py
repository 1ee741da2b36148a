"""Terrain maps and their exact cell size, received in either order."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from machine_sim.node.machine_node import MachineNode
from msg_bridge.codec import qos
from msg_bridge.codec.run_config import RunFacts, to_config_yaml
from msg_bridge.codec.terrain import TerrainMap, cells_of_terrain, to_terrain_cloud
from msg_bridge.codec.terrain_tiles import TileRound, tile_outlines, tile_to_cdr
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.messages import Keyframe
from msg_bridge.nodes import map_decoder
from msg_bridge.nodes.map_decoder import MapDecoder
from msg_bridge.testing.ros_context import Ros


def map_of(cell: float, run_id: int = 1) -> PointCloud2:
    grid = Grid(65, 65, cell)
    level = np.zeros(grid.shape)
    return to_terrain_cloud(TerrainMap(Keyframe(run_id, 0, grid, level), level), "m", Time())


class Reader(MapDecoder):
    """Decoder that collects the cell sizes of accepted maps and the reasons of rejections."""

    def __init__(self, *, guess: bool = False) -> None:
        self.cells: list[float] = []
        self.reasons: list[str] = []
        super().__init__(
            lambda frame: self.cells.append(frame.grid.cell),
            lambda topic, reason: self.reasons.append(reason),
            simulation_namespace="",
            guess=guess,
        )


CELL = 1.0 / 3.0


def test_map_received_first_is_decoded_once_when_the_cell_size_arrives() -> None:
    reader = Reader()
    reader.read_map(map_of(CELL))
    assert (reader.cells, reader.reasons) == ([], [])
    reader.set_cell(CELL)
    reader.set_cell(CELL)
    assert (reader.cells, reader.reasons) == ([CELL], [])


def test_map_with_another_cell_size_waits_for_the_new_cell_size() -> None:
    reader = Reader()
    reader.set_cell(0.2)
    reader.read_map(map_of(0.2))
    reader.read_map(map_of(0.1))
    assert reader.cells == [0.2]
    reader.set_cell(0.1)
    assert reader.cells == [0.2, 0.1]


def test_decoder_that_may_guess_the_cell_size_decodes_at_once() -> None:
    reader = Reader(guess=True)
    reader.read_map(map_of(0.2))
    reader.read_map(map_of(CELL))
    assert reader.cells == pytest.approx([0.2, CELL], rel=1e-6)


def test_map_that_is_not_needed_is_not_decoded() -> None:
    reader = Reader()
    reader.is_needed = lambda run_id: run_id == 2
    reader.read_map(map_of(0.2, run_id=2))  # waits for the cell size
    reader.read_map(map_of(0.2, run_id=1))
    reader.set_cell(0.2)
    assert reader.cells == []
    reader.read_map(map_of(0.2, run_id=2))
    assert reader.cells == [0.2]


def test_malformed_map_is_rejected() -> None:
    reader = Reader()
    reader.set_cell(0.2)
    reader.read_map(PointCloud2())
    assert reader.cells == []
    assert len(reader.reasons) == 1


def test_lost_tile_is_sent_again_to_a_new_subscription(monkeypatch: pytest.MonkeyPatch) -> None:
    grid = Grid(200, 140, 0.2)
    level = np.zeros(grid.shape)
    cells = cells_of_terrain(TerrainMap(Keyframe(3, 7, grid, level), level))
    outlines = list(tile_outlines(grid.shape))
    tile_round = TileRound(3, 7, 7, len(outlines), *grid.shape)
    tiles = [tile_to_cdr(cells, each, tile_round, "map", Time()) for each in outlines]
    now = 100.0
    monkeypatch.setattr(map_decoder.time, "monotonic", lambda: now)
    calls: list[str] = []
    poller: Any = SimpleNamespace(
        subscribe=lambda kind, topic, *_, triggers, **__: calls.append(f"+{topic} {triggers}"),
        unsubscribe=lambda topic: calls.append(f"-{topic}"),
    )
    reader = Reader()
    reader.set_cell(0.2)
    reader.subscribe(poller, triggers=False)
    begun = ["+/terrain/map False", "+/terrain/tiles True"]  # tiles may be the last messages
    assert calls == begun
    calls.clear()
    for tile in tiles[:-1]:
        reader.read_tile(tile)
    now += 1.9
    reader.check(poller)
    assert calls == []
    now += 0.2
    reader.check(poller)
    assert calls == ["-/terrain/map", "-/terrain/tiles", *begun]
    for tile in tiles:
        reader.read_tile(tile)
    assert (reader.cells, reader.reasons) == ([0.2], [])
    reader.read_tile(tiles[0][:1000])
    assert len(reader.reasons) == 1


def test_machine_follows_a_restarted_soil_with_another_cell_size(ros: Ros) -> None:
    machine = ros.add(MachineNode)
    maps = ros.publisher("/terrain/map", PointCloud2, qos.TRANSIENT_LOCAL, subscriptions=1)
    configs = ros.publisher("/sim/config", String, qos.TRANSIENT_LOCAL, subscriptions=1)
    for run_id, cell in ((100, 0.4), (200, 0.3)):
        maps.publish(map_of(cell, run_id))
        ros.spin_for(0.1)  # so that the map is received first
        facts = RunFacts(
            run_id=run_id, tick_period=0.01, realtime=False, cell=cell, soils=(LooseSoil(0.2),)
        )
        configs.publish(String(data=to_config_yaml(facts, {})))

        def begun(run_id: int = run_id) -> bool:
            return machine.run is not None and machine.run.facts.run_id == run_id

        ros.spin_until(begun)
        assert machine.run is not None
        assert machine.run.sim.ground.grid.cell == cell
