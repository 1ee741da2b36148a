"""Soil keeps its moisture from column to bucket and back to the ground, in a whole world."""

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
    """Volume times moisture [mm^3 %]."""
    return int((volume.astype(np.int64) * moisture.astype(np.int64)).sum())


def water_in(columns: Columns) -> int:
    """Of all columns [mm^3 %]."""
    firm = water_of(columns.firm, columns.moisture)
    return firm + water_of(columns.loose, columns.loose_moisture)


@dataclass
class Book:
    """What the rows of a world have moved: EXCAVATE less DEPOSIT and OUTSIDE [mm^3 %]."""

    world: World
    held: int = 0
    dug: int = 0

    def step(self) -> Rows:
        self.world.step()
        if 1 not in self.world.answers:  # to the first tick, one tick later
            return empty_rows(CONVERSION)
        rows: Rows = self.world.answers[1].conversions
        water = rows["volume_mm3"].astype(np.int64) * rows["moisture"]
        out = rows["kind"] == ConversionKind.EXCAVATE
        back = (rows["kind"] == ConversionKind.DEPOSIT) | (rows["kind"] == ConversionKind.OUTSIDE)
        self.held += int(water[out].sum()) - int(water[back].sum())
        self.dug += int(water[out].sum())
        return rows

    @property
    def carried(self) -> int:
        """What the machine says it holds [mm^3 %]."""
        machine = self.world.machines[1]
        state = machine.particles.state
        return machine.tool_coupling.pending.water + water_of(state.volume_mm3, state.moisture)


def world_on(moisture: NDArray[np.uint8], *, mode: str = "spheres") -> World:
    """Level loam of given moistures, and a machine whose lip is just above it."""
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
    """Let the arm go toward a pose: swing [rad], lip's reach and height [m], pitch [rad]."""
    wanted = np.array([swing, *solve_arm_angles(DESCRIPTION, reach, height - HIP, pitch)])
    error = wanted - machine.machine.joint_positions
    machine.command(np.clip(4.0 * error, -0.8, 0.8), np.zeros(2))


def dig(book: Book) -> Iterator[Rows]:
    """Draw the lip through the ground before the machine, and lift it."""
    machine = book.world.machines[1]
    for part in np.linspace(0.0, 1.0, 220):
        depth = 0.25 * np.sin(np.pi * part)
        steer(machine, 0.0, 7.0 - 1.5 * part, 0.05 - depth, 2.0 + 0.7 * part)
        yield book.step()
    for _ in range(120):
        steer(machine, 0.0, 5.8, 1.6, 2.9)
        yield book.step()


def dump(book: Book) -> Iterator[Rows]:
    """Turn to the left and tip the bucket out, until all of it lies."""
    machine = book.world.machines[1]
    for tick in range(900):
        steer(machine, 1.6, 6.0, 1.4, 2.8 if tick < 350 else 1.0)
        yield book.step()


def patch(**box: tuple[float, float]) -> NDArray[np.uint8]:
    """WET where x and y [m] are within a box, DRY elsewhere."""
    x = GRID.x(np.arange(GRID.rows, dtype=float))[:, None]
    y = GRID.y(np.arange(GRID.cols, dtype=float))[None, :]
    (x0, x1), (y0, y1) = box["x"], box["y"]
    inside = (x >= x0) & (x <= x1) & (y >= y0) & (y <= y1)
    return np.where(inside, WET, DRY).astype(np.uint8)


@pytest.mark.parametrize("mode", ["spheres", "cubes"])
def test_a_wet_patch_dug_and_dumped_on_dry_ground_is_as_wet_as_it_was(mode: str) -> None:
    world = world_on(patch(x=(3.0, 9.0), y=(-2.0, 2.0)), mode=mode)
    book, columns = Book(world), world.soil.columns
    particles = world.machines[1].particles
    start = water_in(columns)
    for _ in dig(book):
        pass
    assert particles.count > 20
    assert set(particles.state.moisture.tolist()) == {WET}
    for _ in dump(book):
        pass
    away = GRID.y(np.arange(GRID.cols, dtype=float)) > 3.0
    heap = (columns.loose > 0) & away
    assert columns.loose[heap].sum() > 50_000_000
    assert set(columns.loose_moisture[heap].tolist()) == {WET}
    assert set(columns.moisture[heap].tolist()) == {DRY}
    # Nothing was mixed, so nothing was rounded.
    assert book.carried == book.held
    for _ in range(3):  # what is still in flight
        book.step()
    assert water_in(columns) + book.carried == start
    world.close()


def test_across_the_edge_of_a_wet_patch_soil_mixes_and_keeps_its_water() -> None:
    world = world_on(patch(x=(3.0, 9.0), y=(0.05, 4.0)))
    book, columns = Book(world), world.soil.columns
    machine = world.machines[1]
    state = machine.particles.state
    start, found = water_in(columns), columns.moisture.copy()
    firm = columns.firm.copy()
    for k, rows in enumerate(dig(book)):
        out = rows[rows["kind"] == ConversionKind.EXCAVATE]
        wet = out["moisture"]
        if k < 40:  # no soil has slipped yet
            assert np.array_equal(wet, found[out["row"], out["col"]])
        assert ((wet >= DRY) & (wet <= WET)).all()
        assert book.carried == book.held, "what is held is what the rows have given, to the mm3"
    assert (columns.firm < firm).any()
    kinds = np.unique(state.moisture)
    assert {DRY, WET} <= set(kinds.tolist())
    table = {int(m): c for m, c in zip(state.moisture, state.cohesion, strict=True)}
    ground = world.soil.loose_soils[0]
    assert table[WET] / table[DRY] == pytest.approx(
        ground.moisture_strength_factor(WET) / ground.moisture_strength_factor(DRY)
    )
    for _ in dump(book):
        pass
    assert book.carried == book.held
    for _ in range(3):
        book.step()
    # Where soils mix in the ground their moistures are rounded, up as often as down.
    assert abs(water_in(columns) + book.carried - start) < 0.02 * book.dug
    world.close()


def test_equal_digs_in_patchy_ground_end_in_equal_states() -> None:
    hashes = []
    for wetter in (0, 0, 1):
        moisture = patch(x=(3.0, 9.0), y=(0.05, 4.0))
        moisture[moisture == WET] += wetter
        world = world_on(moisture)
        for _ in dig(Book(world)):
            pass
        hashes.append((world.state_hash(), world.machines[1].state_hash()))
        world.close()
    assert hashes[0] == hashes[1]
    assert hashes[0][0] != hashes[2][0]
