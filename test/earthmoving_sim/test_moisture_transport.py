"""Soil keeps its moisture from column to bucket and back to the ground."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray
from support.machine_scenes import GRID, excavator, loose_soil_options

from earthmoving_sim.world import World
from machine_sim.dem import ParticleParams
from machine_sim.machine.arm_kinematics import arm_geometry, solve_arm_angles
from machine_sim.simulated_machine import Placement
from machine_sim.simulation import MachineSim
from msg_bridge.contract.rows import CONVERSION, ConversionKind, Rows, empty_rows
from soil_sim.columns.state import Columns
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams

DESCRIPTION = excavator()
HIP = arm_geometry(DESCRIPTION).swing[2]
WET, DRY = 55, 5


def water_of(volume: NDArray[np.integer], moisture: NDArray[np.integer]) -> int:
    """Return the volume times moisture [mm^3 %]."""
    return int((volume.astype(np.int64) * moisture.astype(np.int64)).sum())


def water_in(columns: Columns) -> int:
    """Return the water of all columns [mm^3 %]."""
    firm = water_of(columns.firm, columns.moisture)
    return firm + water_of(columns.loose, columns.loose_moisture)


@dataclass
class WaterBalance:
    """Water moved by the conversion rows of a world [mm^3 %].

    Attributes:
        world: the world, with machine 1.
        expected: water of EXCAVATE rows minus that of DEPOSIT and OUTSIDE rows.
        excavated: water of EXCAVATE rows.
    """

    world: World
    expected: int = 0
    excavated: int = 0

    def step(self) -> Rows:
        self.world.step()
        if 1 not in self.world.answers:  # the first answer comes one tick later
            return empty_rows(CONVERSION)
        rows: Rows = self.world.answers[1].conversions
        water = rows["volume_mm3"].astype(np.int64) * rows["moisture"]
        excavated = rows["kind"] == ConversionKind.EXCAVATE
        returned = (rows["kind"] == ConversionKind.DEPOSIT) | (
            rows["kind"] == ConversionKind.OUTSIDE
        )
        self.expected += int(water[excavated].sum()) - int(water[returned].sum())
        self.excavated += int(water[excavated].sum())
        return rows

    @property
    def carried(self) -> int:
        """Water of the machine's pending soil and particles [mm^3 %]."""
        machine = self.world.machines[1]
        particles = machine.particles
        return machine.tool_coupling.pending.accounted_water + water_of(
            particles.volumes_mm3, particles.moisture
        )


def world_on(moisture: NDArray[np.uint8], *, mode: str = "spheres") -> World:
    """Return level loam of given moistures, and a machine whose lip is just above it."""
    angles = solve_arm_angles(DESCRIPTION, 7.0, 0.1 - HIP, 2.0)
    soil = Soil(GRID, np.zeros(GRID.shape), SoilParams(soil="loam"), moisture=moisture)
    machine = MachineSim(
        [Placement(replace(DESCRIPTION, home=np.array([0.0, *angles])))],
        soil.grid,
        soil.columns.height,
        particle_params=ParticleParams(nominal_volume=4_000_000, mode=mode),
        **loose_soil_options(soil),
    )
    return World(soil, {1: machine})


def steer(machine: MachineSim, swing: float, reach: float, height: float, pitch: float) -> None:
    """Move the arm toward a pose: swing [rad], lip's reach and height [m], pitch [rad]."""
    target = np.array([swing, *solve_arm_angles(DESCRIPTION, reach, height - HIP, pitch)])
    error = target - machine.machine.joint_positions
    machine.command(np.clip(4.0 * error, -0.8, 0.8), np.zeros(2))


def dig(balance: WaterBalance) -> Iterator[Rows]:
    """Draw the lip through the ground and lift it; yield the rows of each tick."""
    machine = balance.world.machines[1]
    for fraction in np.linspace(0.0, 1.0, 220):
        depth = 0.25 * np.sin(np.pi * fraction)
        steer(machine, 0.0, 7.0 - 1.5 * fraction, 0.05 - depth, 2.0 + 0.7 * fraction)
        yield balance.step()
    for _ in range(120):
        steer(machine, 0.0, 5.8, 1.6, 2.9)
        yield balance.step()


def dump(balance: WaterBalance) -> Iterator[Rows]:
    """Swing to the left and dump until all soil is at rest; yield the rows of each tick."""
    machine = balance.world.machines[1]
    for tick in range(900):
        steer(machine, 1.6, 6.0, 1.4, 2.8 if tick < 350 else 1.0)
        yield balance.step()


def land_rows_in_flight(balance: WaterBalance) -> None:
    """Step until the machine has applied all rows of the soil: a row counts on both sides before.

    A particle may come to rest in any tick, so no fixed number of ticks is enough.
    """
    for _ in range(300):
        balance.step()
        if balance.world.ledger.in_flight == 0:
            return
    raise AssertionError(f"rows are still in flight: {balance.world.ledger}")


def patch(**box: tuple[float, float]) -> NDArray[np.uint8]:
    """Return moistures: WET where x and y [m] are within a box, DRY elsewhere."""
    x = GRID.x(np.arange(GRID.rows, dtype=float))[:, None]
    y = GRID.y(np.arange(GRID.cols, dtype=float))[None, :]
    (x0, x1), (y0, y1) = box["x"], box["y"]
    inside = (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)
    return np.where(inside, WET, DRY).astype(np.uint8)


@pytest.mark.parametrize("mode", ["spheres", "cubes"])
def test_wet_soil_dumped_on_dry_ground_keeps_its_moisture(mode: str) -> None:
    world = world_on(patch(x=(3.0, 9.0), y=(-2.0, 2.0)), mode=mode)
    balance, columns = WaterBalance(world), world.soil.columns
    particles = world.machines[1].particles
    start = water_in(columns)
    for _ in dig(balance):
        pass
    assert particles.count > 0
    assert set(particles.moisture.tolist()) == {WET}
    for _ in dump(balance):
        pass
    is_dump_side = GRID.y(np.arange(GRID.cols, dtype=float)) > 3.0
    heap = (columns.loose > 0) & is_dump_side
    assert heap.any()
    assert set(columns.loose_moisture[heap].tolist()) == {WET}
    assert set(columns.moisture[heap].tolist()) == {DRY}
    # Soils of one moisture mix without rounding.
    assert balance.carried == balance.expected
    land_rows_in_flight(balance)
    assert water_in(columns) + balance.carried == start
    world.close()


def test_soil_dug_across_the_edge_of_a_wet_patch_keeps_its_water() -> None:
    world = world_on(patch(x=(3.0, 9.0), y=(0.05, 4.0)))
    balance, columns = WaterBalance(world), world.soil.columns
    machine = world.machines[1]
    particles = machine.particles
    start, initial_moisture = water_in(columns), columns.moisture.copy()
    firm = columns.firm.copy()
    for k, rows in enumerate(dig(balance)):
        excavated = rows[rows["kind"] == ConversionKind.EXCAVATE]
        moisture = excavated["moisture"]
        if k < 40:  # before any slope fails
            assert np.array_equal(moisture, initial_moisture[excavated["row"], excavated["col"]])
        assert ((moisture >= DRY) & (moisture <= WET)).all()
        assert balance.carried == balance.expected, (
            "the machine carries the water of its rows, to the mm3"
        )
    assert (columns.firm < firm).any()
    assert {DRY, WET} <= set(particles.moisture.tolist())
    cohesion_by_moisture = zip(
        particles.moisture, particles.contact_coefficients.cohesion, strict=True
    )
    cohesion = {int(moisture): value for moisture, value in cohesion_by_moisture}
    loose_soil = world.soil.loose_soils[0]
    assert cohesion[WET] / cohesion[DRY] == pytest.approx(
        loose_soil.moisture_strength_factor(WET) / loose_soil.moisture_strength_factor(DRY)
    )
    for _ in dump(balance):
        pass
    assert balance.carried == balance.expected
    land_rows_in_flight(balance)
    # Where soils of different moisture mix, the moisture is rounded stochastically, without bias.
    assert abs(water_in(columns) + balance.carried - start) < 0.02 * balance.excavated
    world.close()


def test_equal_digs_end_in_equal_states_and_moisture_changes_them() -> None:
    hashes = []
    for wetter in (0, 0, 1):
        moisture = patch(x=(3.0, 9.0), y=(0.05, 4.0))
        moisture[moisture == WET] += wetter
        world = world_on(moisture)
        for _ in dig(WaterBalance(world)):
            pass
        hashes.append((world.state_hash(), world.machines[1].state_hash()))
        world.close()
    assert hashes[0] == hashes[1]
    assert hashes[0][0] != hashes[2][0]
