"""Terrains of the pictures in `soil_gallery`: piles, trenches, a pit with heaps, and ruts."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from benchmarks.bucket_sweeps import NO_DEPOSIT_REQUESTS, NO_SWEEPS, bucket_sweep
from earthmoving_sim.world import World
from machine_sim.machine import load_machine_spec
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.config_files import find_config
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import DEPOSIT_REQUEST, ConversionKind, Rows, empty_rows
from soil_sim.columns.state import SurfaceMaterial
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.soils.soil_types import load_soil_types

__all__ = [
    "deposit_rows",
    "make_pile",
    "make_pit",
    "make_ruts",
    "make_trench",
    "measure_pile_angle",
    "step_until_at_rest",
]


def deposit_rows(x: float, y: float, volumes: NDArray[np.integer], moisture: int) -> Rows:
    """Return DEPOSIT_REQUEST rows of machine 1 at one position.

    Args:
        x, y: position [m], map frame.
        volumes: bank volume of each row [mm^3], shape (n,).
        moisture: [% of saturation].
    """
    rows = empty_rows(DEPOSIT_REQUEST, volumes.size)
    rows["x"], rows["y"], rows["volume_mm3"] = x, y, volumes
    rows["moisture"], rows["machine_id"] = moisture, 1
    rows["particle_id"] = np.arange(1, volumes.size + 1)
    return rows


def make_pile(soil_name: str, radius: float = 2.0, num_deposits: int = 800) -> Soil:
    """Return a pile of a shipped soil at its shipped moisture.

    Args:
        soil_name: name in `config/soils.yaml`.
        radius: radius [m] of the cone at the angle of repose that has the pile's volume.
        num_deposits: number of equal deposits.
    """
    soil_type = load_soil_types()[soil_name]
    grid = Grid(65, 65, 0.1)
    soil = Soil(grid, np.zeros(grid.shape), SoilParams(soil=soil_name))
    slope = math.tan(soil_type.repose_angle_at(soil_type.moisture))
    loose_volume = math.pi / 3 * slope * radius**3
    bank_volume = loose_volume * 1e9 / (1 + soil_type.swell)
    volumes = np.array([round(bank_volume / num_deposits)])
    for tick in range(num_deposits):
        soil.step(tick, NO_SWEEPS, deposit_rows(0.0, 0.0, volumes, soil_type.moisture))
    step_until_at_rest(soil)
    return soil


def measure_pile_angle(soil: Soil) -> float:
    """Return the slope angle of a pile [deg], fitted from 0.2 to 0.8 of its height."""
    grid, height = soil.grid, soil.columns.height
    x, y = grid.x(np.arange(grid.rows)), grid.y(np.arange(grid.cols))
    distance = np.hypot(x[:, None], y[None, :])
    is_flank = (height > 0.2 * height.max()) & (height < 0.8 * height.max())
    return math.degrees(math.atan(-np.polyfit(distance[is_flank], height[is_flank], 1)[0]))


def make_trench(soil_name: str) -> Soil:
    """Return a trench 1.5 m deep whose walls begin to fail, with few cell visits per tick."""
    grid = Grid(49, 71, 0.1)
    heights = np.zeros(grid.shape)
    heights[:, np.abs(grid.y(np.arange(grid.cols))) < 0.8] = -1.5
    soil = Soil(grid, heights, SoilParams(soil=soil_name, max_cell_visits_per_tick=100))
    soil.columns.material[heights < 0.0] = SurfaceMaterial.EXCAVATED
    soil.relaxation.mark_all_disturbed()
    return soil


def step_until_at_rest(soil: Soil) -> int:
    """Step a terrain until no cell waits for relaxation; return the number of ticks."""
    ticks = 0
    while soil.relaxation.num_pending:
        soil.step(ticks, NO_SWEEPS, NO_DEPOSIT_REQUESTS)
        ticks += 1
    return ticks


def make_pit() -> Soil:
    """Return a pit in loam, dry on one side and wet on the other, with heaps of its soil."""
    grid = Grid(141, 121, 0.06)
    x, y = np.meshgrid(grid.x(np.arange(141)), grid.y(np.arange(121)), indexing="ij")
    rng = np.random.default_rng(3)
    heights = sum(
        0.03 * np.sin(x * rng.normal() + y * rng.normal() + rng.uniform(0, 6)) for _ in range(8)
    )
    moisture = np.rint(np.clip(50.0 - 70.0 * y, 0.0, 95.0)).astype(int)
    soil = Soil(grid, np.asarray(heights), SoilParams(soil="loam"), moisture=moisture)
    _dump(soil, *_dig_pit(soil), rng)
    step_until_at_rest(soil)
    return soil


def _dig_pit(soil: Soil) -> tuple[int, NDArray[np.int64], NDArray[np.uint8], NDArray[np.float64]]:
    """Dig two lanes in three passes each.

    Returns:
        (number of ticks, excavated bank volumes [mm^3], their moisture [%], y of their lane [m]).
    """
    tick, volumes, moisture, lanes = 0, [], [], []
    for lane in (0.55, -0.55):
        for depth in (0.35, 0.7, 1.0):
            for start, end in pairwise(_lip_path(lane, depth)):
                rows = soil.step(tick, bucket_sweep(start, end), NO_DEPOSIT_REQUESTS).conversions
                rows = rows[rows["kind"] == ConversionKind.EXCAVATE]
                volumes.append(rows["volume_mm3"].astype(np.int64))
                moisture.append(soil.columns.moisture[rows["row"], rows["col"]])
                lanes.append(np.full(rows.size, lane))
                tick += 1
    return tick, np.concatenate(volumes), np.concatenate(moisture), np.concatenate(lanes)


def _lip_path(y: float, depth: float) -> NDArray[np.float64]:
    """Return positions of the bucket's lip [m] for one pass at a depth [m], shape (n, 3)."""
    corners = np.array(
        [(-2.2, 0.3), (-2.0 + 0.3 * depth, -depth), (0.2 - 0.4 * depth, -depth), (0.6, 0.5)]
    )
    points = np.concatenate([np.linspace(a, b, 60, endpoint=False) for a, b in pairwise(corners)])
    return np.stack([points[:, 0], np.full(len(points), y), points[:, 1]], axis=1)


def _dump(
    soil: Soil,
    tick: int,
    volumes: NDArray[np.int64],
    moisture: NDArray[np.uint8],
    lanes: NDArray[np.float64],
    rng: np.random.Generator,
    group: int = 100,
) -> None:
    """Deposit excavated soil, in groups of columns, on a heap in line with its lane."""
    for first in range(0, volumes.size, group):
        part = slice(first, first + group)
        mean_moisture = round(float(np.average(moisture[part], weights=volumes[part] + 1.0)))
        x, y = rng.normal((2.4, 2.6 * float(lanes[first])), 0.12)
        total = np.array([volumes[part].sum()])
        soil.step(tick, NO_SWEEPS, deposit_rows(x, y, total, mean_moisture))
        tick += 1


def make_ruts() -> Soil:
    """Return wet loam on which an excavator drove straight, in a left curve, and straight."""
    grid = Grid(151, 91, 0.1)
    soil = Soil(grid, np.zeros(grid.shape), SoilParams(soil="loam", moisture=100))
    machine = MachineSim(
        [Placement(load_machine_spec(find_config("machines/excavator.yaml")), (-5.0, -1.5))],
        grid,
        soil.columns.height,
        soils=soil.loose_soils,
        moisture=soil.columns.top_moisture,
    )
    world = World(soil, {1: machine})
    for left, right, ticks in ((1.0, 1.0, 350), (0.55, 1.0, 350), (1.0, 1.0, 200)):
        machine.command(np.zeros(4), np.array([left, right]))
        for _ in range(ticks):
            world.step()
    world.close()
    return soil
