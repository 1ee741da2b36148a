"""No soil slides into the rut that a track stands in."""

from __future__ import annotations

import numpy as np
from support.soil_scenes import NO_DEPOSIT_REQUESTS, NO_SWEEPS, tool_sweep

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import Rows, SweepAction, join_rows
from soil_sim.columns.occupancy import FREE, TOOL_INSIDE, TRACK_ABOVE
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.track_occupancy import TrackOccupancy

GRID = Grid(81, 81, 0.05)
UNDER = (slice(35, 46), slice(35, 46))
PRESSURE = 100e3


def shoe(x: float, z: float) -> Rows:
    """Return the sweep of a shoe of 0.6 x 0.6 m that moves toward +x by 1 cm."""
    rows = tool_sweep(((0.3, 0.0), (-0.3, 0.0)), (x, 0, z), (x + 0.01, 0, z), width=0.6)
    rows["action"], rows["pressure"] = SweepAction.COMPACT, PRESSURE
    return rows


def bucket_in_the_air() -> Rows:
    rows = tool_sweep(((0.0, 0.0), (-0.5, 0.0)), (0, 0, 2.0), (0, 0, 2.0))
    rows["tool"] = 5
    return rows


def test_sand_slides_into_a_rut_only_when_the_track_has_left() -> None:
    soil = Soil(GRID, np.zeros(GRID.shape), SoilParams(soil="dry sand"))
    soil.step(0, shoe(0.0, -0.08), NO_DEPOSIT_REQUESTS)
    assert soil.relaxation.occupied[40, 40] == TRACK_ABOVE
    rut = soil.columns.height[UNDER].copy()
    assert rut.max() < -0.05
    for tick in range(1, 20):  # at rest: the machine sends the rows of its other tools only
        soil.step(tick, bucket_in_the_air(), NO_DEPOSIT_REQUESTS)
    assert (soil.columns.height[UNDER] == rut).all()
    assert not soil.columns.loose[UNDER].any()
    for tick in range(20, 40):
        soil.step(tick, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
    assert not soil.relaxation.occupied.any()
    assert soil.columns.loose[34:47, 34:47].any(), "the sides of the rut have failed"
    assert soil.verify_volume()


def test_marks_are_those_of_each_machine_and_marks_of_tools_are_kept() -> None:
    occupied = np.zeros((2, 3), dtype=np.uint8)
    tracks = TrackOccupancy(occupied)
    occupied[0, 0] = TOOL_INSIDE
    assert tracks.end_tick({1: {5: np.array([0, 1])}, 2: {5: np.array([4])}}).size == 0
    assert occupied.tolist() == [[TOOL_INSIDE, TRACK_ABOVE, FREE], [FREE, TRACK_ABOVE, FREE]]
    assert tracks.end_tick({1: {5: np.array([0, 2])}, 2: {}}).tolist() == [1]
    assert occupied.tolist() == [[TOOL_INSIDE, FREE, TRACK_ABOVE], [FREE, TRACK_ABOVE, FREE]]
    # Another machine of the same node drives.
    assert tracks.end_tick({1: {7: np.array([3])}}).tolist() == [4]
    assert occupied.tolist() == [[TOOL_INSIDE, FREE, TRACK_ABOVE], [TRACK_ABOVE, FREE, FREE]]
    assert tracks.end_tick({}).tolist() == [2, 3]
    assert occupied.tolist() == [[TOOL_INSIDE, FREE, FREE], [FREE, FREE, FREE]]


def test_both_tracks_of_a_machine_are_marked() -> None:
    soil = Soil(GRID, np.zeros(GRID.shape), SoilParams(soil="dry sand"))
    other = shoe(0.0, -0.05)
    other["tool"] = 1
    for end in "01":
        other[f"y{end}"] += 1.2
    soil.step(0, join_rows([shoe(0.0, -0.05), other], other.dtype), NO_DEPOSIT_REQUESTS)
    assert soil.relaxation.occupied[40, [40, 16]].tolist() == [TRACK_ABOVE] * 2
