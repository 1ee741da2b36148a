"""Tracks leave ruts in loose and in firm soil, and the volume stays exact."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from support.machine_scenes import excavator, loose_soil_options
from support.soil_scenes import NO_SWEEPS, make_deposit_requests, reference_soil

from earthmoving_sim.world import World
from machine_sim.machine.tracks.track_model import TrackModel
from machine_sim.params import MachineSimParams
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.contract.grid import Grid
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

GRID = Grid(81, 61, 0.2)
DEPTH = 0.2  # depth of loose soil [m]


def loose_ground(**params: object) -> Soil:
    soil = Soil(GRID, np.zeros(GRID.shape), reference_soil(**params))
    bulking_factor = 1.0 + soil.soil_types[0].swell
    volume = round(DEPTH / bulking_factor / soil.columns.metres_per_mm3)
    x, y = np.meshgrid(GRID.x(np.arange(81)), GRID.y(np.arange(61)), indexing="ij")
    requests = make_deposit_requests(x.reshape(-1), y.reshape(-1), volume)
    requests["moisture"] = soil.loose_soils[0].moisture
    soil.step(0, NO_SWEEPS, requests)
    return soil


def world_on(soil: Soil, tracks: TrackModel = "kinematic") -> tuple[World, MachineSim]:
    """Return a world with a machine at x = -4 m that faces +x."""
    machine = MachineSim(
        [Placement(excavator(), (-4.0, 0.0))],
        soil.grid,
        soil.columns.height,
        **loose_soil_options(soil),
        params=MachineSimParams(track_model=tracks),
        soil=soil.columns.top_soil,
        moisture=soil.columns.top_moisture,
    )
    return World(soil, {1: machine}), machine


def drive(world: World, machine: MachineSim, speed: float, ticks: int) -> None:
    machine.command(np.zeros(4), np.array([speed, speed]))
    assert {world.step().imbalance for _ in range(ticks)} == {0}


def heights_in_ruts(soil: Soil, machine: MachineSim) -> NDArray[np.float64]:
    """Return the height of the soil below the middle of both tracks, left and right [m]."""
    grid, half = soil.grid, 0.5 * machine.machine.spec.tracks.gauge
    row = round(grid.row(machine.machine.base_pose[0][0]))
    heights: NDArray[np.float64] = soil.columns.height[
        row, [round(grid.col(half)), round(grid.col(-half))]
    ]
    return heights


def test_tracks_leave_ruts_only_where_they_drove() -> None:
    soil = loose_ground(soil="topsoil")
    world, machine = world_on(soil)
    start = machine.machine.base_pose[0][0]
    drive(world, machine, 1.0, 300)
    end = machine.machine.base_pose[0][0]
    world.close()
    assert end - start > 2.0
    tracks = machine.machine.spec.tracks
    sunk = DEPTH - soil.columns.height
    row = round(GRID.row(0.5 * (start + end)))
    left, right = round(GRID.col(0.5 * tracks.gauge)), round(GRID.col(-0.5 * tracks.gauge))
    middle, beside = round(GRID.col(0.0)), round(GRID.col(3.0))
    assert min(sunk[row, left], sunk[row, right]) > 0.01
    assert abs(sunk[row, middle]) < 1e-6
    assert abs(sunk[row, beside]) < 1e-6
    assert abs(sunk[round(GRID.row(end + 3.0)), left]) < 1e-6, "ahead of the machine"
    assert (soil.columns.bulk >= soil.columns.loose).all()


@pytest.mark.parametrize("tracks", ["kinematic", "dynamic"])
def test_depth_of_ruts_is_the_sinkage_of_the_tracks(tracks: TrackModel) -> None:
    soil = loose_ground(soil="topsoil")
    world, machine = world_on(soil, tracks)
    drive(world, machine, 1.0, 350)
    depth = DEPTH - heights_in_ruts(soil, machine)
    sinkage = machine.machine.tracks.sinkage.copy()
    world.close()
    assert sinkage.min() > 0.02
    assert depth == pytest.approx(sinkage, abs=0.012)
    assert soil.verify_volume()


def test_sinkage_does_not_grow_at_rest_or_on_the_way_back() -> None:
    soil = loose_ground(soil="dry sand")
    world, machine = world_on(soil)
    drive(world, machine, 1.0, 300)
    before = machine.machine.base_pose[0][2]
    drive(world, machine, 0.0, 200)
    assert machine.machine.base_pose[0][2] == pytest.approx(before, abs=0.015)
    drive(world, machine, -1.0, 300)
    assert machine.machine.base_pose[0][2] == pytest.approx(before, abs=0.02)
    world.close()


@pytest.mark.parametrize(
    ("kind", "moisture", "cell", "tracks"),
    [
        ("loam", 100, 0.2, "kinematic"),
        ("loam", 100, 0.2, "dynamic"),
        ("dry sand", 0, 0.05, "kinematic"),  # whose ruts are steeper than its angle of repose
    ],
)
def test_tracks_leave_the_rut_in_firm_soil_that_they_stand_in(
    kind: str, moisture: int, cell: float, tracks: TrackModel
) -> None:
    count = 2 * round(8.0 / cell) + 1
    grid = Grid(count, round(0.75 * count), cell)
    soil = Soil(grid, np.zeros(grid.shape), SoilParams(soil=kind, moisture=moisture))
    before = soil.total_mm3
    world, machine = world_on(soil, tracks)
    drive(world, machine, 1.0, 300)
    depth, z = -heights_in_ruts(soil, machine), machine.machine.base_pose[0][2]
    sinkage = machine.machine.tracks.sinkage.copy()
    world.close()
    assert sinkage.min() > 0.04
    assert depth == pytest.approx(-z, rel=0.1), "the machine stands in its rut"
    assert depth == pytest.approx(sinkage, rel=0.4), "which is level, and the machine may pitch"
    assert soil.total_mm3 == before
    assert soil.verify_volume()
