"""Maps and the side length of their cells, received in either order."""

from __future__ import annotations

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from machine_sim.node.machine_node import MachineNode
from msg_bridge.codec import qos
from msg_bridge.codec.run_config import RunFacts, to_config_yaml
from msg_bridge.codec.terrain import TerrainMap, to_terrain_cloud
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.messages import Keyframe
from msg_bridge.nodes.map_decoder import MapDecoder
from msg_bridge.testing.ros_context import Ros


def map_of(cell: float, run_id: int = 1) -> PointCloud2:
    grid = Grid(65, 65, cell)
    level = np.zeros(grid.shape)
    return to_terrain_cloud(TerrainMap(Keyframe(run_id, 0, grid, level), level), "m", Time())


class Reader(MapDecoder):
    """Remembers the cells of what it took, and the reasons of what it refused."""

    def __init__(self, *, guess: bool = False) -> None:
        self.taken: list[float] = []
        self.reasons: list[str] = []
        super().__init__(
            lambda frame: self.taken.append(frame.grid.cell),
            lambda topic, reason: self.reasons.append(reason),
            topic="/terrain/map",
            guess=guess,
        )


CELL = 1.0 / 3.0


def test_a_map_that_comes_first_is_read_exactly_once_its_cells_are_known() -> None:
    reader = Reader()
    reader.read(map_of(CELL))
    assert (reader.taken, reader.reasons) == ([], [])
    reader.set_cell(CELL)
    reader.set_cell(CELL)
    assert (reader.taken, reader.reasons) == ([CELL], [])


def test_a_map_of_other_cells_is_taken_once_they_are_told() -> None:
    reader = Reader()
    reader.set_cell(0.2)
    reader.read(map_of(0.2))
    reader.read(map_of(0.1))
    assert reader.taken == [0.2]
    reader.set_cell(0.1)
    assert reader.taken == [0.2, 0.1]


def test_who_may_never_be_told_reads_at_once() -> None:
    reader = Reader(guess=True)
    reader.read(map_of(0.2))
    reader.read(map_of(CELL))
    assert reader.taken == pytest.approx([0.2, CELL], rel=1e-6)


def test_a_broken_map_is_refused() -> None:
    reader = Reader()
    reader.set_cell(0.2)
    reader.read(PointCloud2())
    assert reader.taken == []
    assert len(reader.reasons) == 1


def test_a_machine_follows_a_soil_that_was_started_again_with_other_cells(ros: Ros) -> None:
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
