"""Milled cut: a drum removes what its work covers, and meets the rest."""

import math

import numpy as np
import pytest
from support.drum_scenes import RADIUS, WIDTH, drum_sweep

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import (
    DEPOSIT_REQUEST,
    MAX_MILLING_WORK,
    ConversionKind,
    SoilReaction,
    empty_rows,
)
from soil_sim.soil import Soil, SoilStepResult
from soil_sim.soils.params import SoilParams
from soil_sim.tool_force.specific_energy import rock_specific_energy

GRID = Grid(65, 65, 0.1)
NOTHING = empty_rows(DEPOSIT_REQUEST)
FACE_X, FACE_HEIGHT = 0.45, 2.0
ROCK_ENERGY = rock_specific_energy(3e6)


def face(soil: str = "rock", **params) -> Soil:
    """Return a face that begins at `FACE_X`, with its floor at height 0."""
    heights = np.where(GRID.x(np.arange(65))[:, None] > FACE_X, FACE_HEIGHT, 0.0)
    return Soil(GRID, heights * np.ones(GRID.shape), SoilParams(soil=soil, **params))


def sump(soil: Soil, work: float, x: float = 0.0, tick: int = 1, depth: float = 0.05):
    """Mill with a drum whose front is `depth` in the face; return the step."""
    x += FACE_X + depth - RADIUS
    return soil.step(tick, drum_sweep((x, 0.0, 0.6), (x, 0.0, 0.6), work), NOTHING)


def excavated(step: SoilStepResult) -> float:
    """Return the excavated bank volume [m^3]."""
    rows = step.conversions[step.conversions["kind"] == ConversionKind.EXCAVATE]
    return float(rows["volume_mm3"].sum()) * 1e-9


def row_of(step: SoilStepResult, reaction: SoilReaction):
    """Return the FORCE row of a reaction; None without one."""
    rows = step.forces[step.forces["reaction"] == reaction]
    return rows[0] if rows.size else None


def test_work_covers_the_specific_energy_of_what_is_removed():
    soil = face()
    before = soil.total_mm3
    step = sump(soil, 5e3)
    assert row_of(step, SoilReaction.MILL)["work"] == pytest.approx(5e3)
    assert excavated(step) * ROCK_ENERGY == pytest.approx(5e3, rel=1e-3)
    assert before - soil.total_mm3 == round(excavated(step) * 1e9)


def test_overhang_is_milled_at_its_cost():
    """The drum reaches from 0.1 to 1.1 m; the face above it goes with it."""
    soil = face()
    step = sump(soil, MAX_MILLING_WORK)
    volume = excavated(step)
    reach = 0.05  # of the front, less where the cylinder curves back
    assert 0.6 * reach * WIDTH * FACE_HEIGHT < volume < reach * WIDTH * FACE_HEIGHT
    assert row_of(step, SoilReaction.MILL)["work"] == pytest.approx(volume * ROCK_ENERGY, rel=1e-4)
    assert row_of(step, SoilReaction.BEARING) is None


def test_soil_that_the_work_does_not_cover_stays_and_bears_the_drum():
    soil = face()
    bearing = row_of(sump(soil, 100.0), SoilReaction.BEARING)
    assert bearing["fx"] < -1e6  # out of the face, beyond any machine
    assert abs(bearing["fy"]) < 0.05 * abs(bearing["fx"])
    assert abs(bearing["x"] - FACE_X) < 0.1
    assert bearing["work"] == 0.0
    assert soil.columns.height[:, 32].max() == FACE_HEIGHT


def test_end_of_the_drum_is_pushed_along_its_axis():
    """A slewing boom presses the end of the drum against the side of its slot."""
    heights = np.where(GRID.y(np.arange(65))[None, :] > 0.45, 1.0, 0.0) * np.ones(GRID.shape)
    soil = Soil(GRID, heights, SoilParams(soil="rock"))
    at = (0.0, 0.0, 0.6)
    bearing = row_of(soil.step(1, drum_sweep(at, at), NOTHING), SoilReaction.BEARING)
    assert bearing["fy"] < 0.0
    assert abs(bearing["fx"]) < 0.05 * abs(bearing["fy"])


def test_work_of_many_ticks_removes_the_envelope():
    soil = face()
    demand = float(row_of(sump(face(), MAX_MILLING_WORK), SoilReaction.MILL)["work"])
    per_tick, used, ticks = demand / 20.5, 0.0, 0
    while ticks < 30:
        ticks += 1
        step = sump(soil, per_tick, tick=ticks)
        used += float(row_of(step, SoilReaction.MILL)["work"])
        if row_of(step, SoilReaction.BEARING) is None:
            break
    assert ticks == 21
    assert used == pytest.approx(demand, rel=1e-3)


def test_loose_soil_goes_before_firm_soil_and_costs_its_lift():
    soil = face("loam")
    columns = soil.columns
    deposits = empty_rows(DEPOSIT_REQUEST, 1)
    deposits["x"], deposits["z"], deposits["volume_mm3"] = 0.0, 0.1, 20_000_000
    soil.step(1, empty_rows(drum_sweep((0, 0, 9), (0, 0, 9)).dtype), deposits)
    loose = int(columns.loose.sum())
    at = (0.0, 0.0, 0.45)
    work = 0.5 * float(loose) * 1e-9 * soil.soil_types[0].density * 9.81 * 2.0 * RADIUS
    firm = int(columns.firm.sum())
    step = soil.step(2, drum_sweep(at, at, work), NOTHING)
    assert int(columns.firm.sum()) == firm
    assert excavated(step) == pytest.approx(0.5 * loose * 1e-9, rel=0.02)


def test_loam_costs_little_of_the_energy_of_rock():
    works = [
        float(row_of(sump(face(kind), MAX_MILLING_WORK), SoilReaction.MILL)["work"])
        for kind in ("rock", "loam", "dry sand")
    ]
    assert works[0] > 20.0 * works[1]
    assert works[1] > 1.5 * works[2] > 0.0


def test_drum_in_the_air_engages_nothing():
    soil = face()
    step = soil.step(1, drum_sweep((0, 0, 4), (0, 0, 4), 1e3), NOTHING)
    (force,) = step.forces
    assert force["reaction"] == SoilReaction.MILL
    assert force["work"] == force["fx"] == force["fz"] == 0.0


def test_drum_excavates_the_part_of_its_cylinder_below_the_surface():
    soil = Soil(GRID, np.zeros(GRID.shape), SoilParams())
    at = (0.0, 0.0, -0.3)
    volume = excavated(soil.step(1, drum_sweep(at, at, MAX_MILLING_WORK), NOTHING))
    x = np.linspace(-RADIUS, RADIUS, 2001)
    depth = 0.3 + np.sqrt(RADIUS**2 - x**2)
    assert volume == pytest.approx(depth.mean() * 2.0 * RADIUS * WIDTH, rel=0.1)


def test_nothing_limits_milling_without_tool_forces():
    soil = face(force_mode="none")
    step = sump(soil, 0.0)
    assert excavated(step) == pytest.approx(excavated(sump(face(), MAX_MILLING_WORK)))
    assert row_of(step, SoilReaction.MILL) is None  # zeros of the reaction CUT


@pytest.mark.parametrize("work", [math.nan, math.inf, -math.inf, -1.0, 1.1 * MAX_MILLING_WORK])
def test_drum_with_invalid_work_is_rejected(work):
    soil = face()
    step = sump(soil, work)
    assert len(step.rejected_tools) == 1
    assert step.forces.size == 0
    assert excavated(step) == 0.0


def test_drum_whose_rows_state_different_work_is_rejected():
    soil, rows = face(), drum_sweep((0, 0, 0.6), (0, 0, 0.6), 1e3)
    rows["work"][5] = 2e3
    assert len(soil.step(1, rows, NOTHING).rejected_tools) == 1
