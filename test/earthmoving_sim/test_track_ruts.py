"""Tracks compact loose soil into ruts, and the volume stays exact."""

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
        GRID,
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


def rut(soil: Soil, machine: MachineSim) -> NDArray[np.float64]:
    """Return the depth of the ruts below the middle of the machine, left and right [m]."""
    half = 0.5 * machine.machine.spec.tracks.gauge
    row = round(GRID.row(machine.machine.base_pose[0][0]))
    cols = [round(GRID.col(half)), round(GRID.col(-half))]
    return DEPTH - soil.columns.height[row, cols]


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
    swell = soil.soil_types[0].swell
    assert sunk.max() <= DEPTH * (1.0 - 1.0 / (1.0 + swell)) + 1e-3, "at most to bank volume"


@pytest.mark.parametrize("tracks", ["kinematic", "dynamic"])
def test_depth_of_ruts_is_the_sinkage_of_the_tracks(tracks: TrackModel) -> None:
    soil = loose_ground(soil="topsoil")
    world, machine = world_on(soil, tracks)
    drive(world, machine, 1.0, 350)
    depth = rut(soil, machine)
    sinkage = machine.machine.tracks.sinkage.copy()
    world.close()
    max_rut_depth = DEPTH * (1.0 - 1.0 / (1.0 + soil.soil_types[0].swell))
    assert sinkage.min() > 0.02
    assert depth == pytest.approx(np.minimum(sinkage, max_rut_depth), abs=0.008)
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


def test_tracks_sink_into_firm_soil_without_changing_it() -> None:
    soil = Soil(GRID, np.zeros(GRID.shape), SoilParams(soil="dry sand"))
    world, machine = world_on(soil)
    drive(world, machine, 1.0, 200)
    assert not soil.columns.height.any()
    assert machine.machine.tracks.sinkage.min() > 0.03
    world.close()
