"""Initial pose of a machine: on the map, on one that its tracks fit on, on uneven ground."""

import numpy as np
import pytest
from support.machine_scenes import GRID

from machine_sim.ground import Ground
from machine_sim.machine import MachineError
from machine_sim.machine.tracks.placement import standing_pose
from machine_sim.params import MachineSimParams
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.contract.grid import Grid
from soil_sim.soils.soil_types import load_soil_types


def level_ground(rows: int, cols: int) -> Ground:
    """Return level ground with columns of 0.2 m."""
    return Ground(Grid(rows, cols, 0.2), np.zeros((rows, cols)))


def test_position_off_the_map_is_rejected(spec):
    with pytest.raises(MachineError, match="off the map"):
        standing_pose(spec, level_ground(65, 65), 7.0, 0.0, 0.0)


@pytest.mark.parametrize(("rows", "cols"), [(2, 2), (14, 65), (65, 14), (19, 19)])
def test_map_smaller_than_the_tracks_is_rejected(spec, rows, cols):
    length = spec.tracks.axle_distance + 2.0 * spec.tracks.sprocket_radius
    assert (length, spec.tracks.gauge + spec.tracks.shoe_width) == pytest.approx((3.864, 2.98))
    with pytest.raises(MachineError, match=r"take 3\.9 x 3\.0 m; .*site\.num_points or site\.cell"):
        standing_pose(spec, level_ground(rows, cols), 0.0, 0.0, 0.0)


@pytest.mark.parametrize(("rows", "cols"), [(20, 15), (15, 20)])
def test_machine_stands_on_a_map_as_large_as_its_tracks(spec, rows, cols):
    position, rotation = standing_pose(spec, level_ground(rows, cols), 0.0, 0.0, 0.0)
    assert position == pytest.approx([0.0, 0.0, 0.0], abs=0.05)
    assert rotation == pytest.approx(np.eye(3))


@pytest.mark.parametrize("soil_name", ["reference", "loam", "wet clay"])
@pytest.mark.parametrize(("height", "x", "y"), [(1.5, 1.8, 1.2), (1.0, 0.0, 0.0), (-1.5, 0.0, 0.0)])
def test_machine_on_a_heap_or_pit_neither_jumps_nor_drops(spec, height, x, y, soil_name):
    """The cone is higher, or deeper, than the plane of best fit under the tracks by up to 0.5 m."""
    rows, cols = np.arange(GRID.rows)[:, None], np.arange(GRID.cols)[None, :]
    distance = np.hypot(GRID.x(rows) - x, GRID.y(cols) - y)
    cone = np.sign(height) * np.maximum(abs(height) - 0.6 * distance, 0.0)
    soil = load_soil_types()[soil_name].loose_soil
    moisture = np.full(GRID.shape, soil.moisture, dtype=np.uint8)
    params = MachineSimParams(track_model="dynamic")  # of both models the one that jumps higher
    sim = MachineSim([Placement(spec)], GRID, cone, params=params, soils=[soil], moisture=moisture)
    before = sim.machine.base_pose[0][2]
    rises = []
    for _ in range(100):
        sim.step()
        rises.append(sim.machine.base_pose[0][2] - before)
    sim.close()
    assert max(rises) < 0.05
    assert abs(rises[-1]) < 0.15
