"""Milling resistance: the work of a drum is the specific energy of the soil it removes."""

import math

import numpy as np
import pytest

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import (
    DEPOSIT_REQUEST,
    SWEEP,
    UNLIMITED_ROOM,
    ConversionKind,
    SoilReaction,
    SweepAction,
    empty_rows,
)
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.tool_force.drum import rock_specific_energy

GRID = Grid(65, 65, 0.1)
RADIUS, WIDTH, PAIRS = 0.5, 1.0, 12
NOTHING = empty_rows(DEPOSIT_REQUEST)


def ring(angle, center):
    """Return the pick tips around a drum, left before right, as a closed ring, shape (26, 3)."""
    turns = angle + 2.0 * math.pi * np.arange(PAIRS + 1) / PAIRS
    points = [
        (RADIUS * math.cos(a), side * 0.5 * WIDTH, -RADIUS * math.sin(a))
        for a in turns
        for side in (1, -1)
    ]
    return np.array(points) + center


def drum(advance, rotation, *, z=-1.0, action=SweepAction.MILL):
    """Return the SWEEP rows of a drum that advances [m] and rotates [rad] in a tick."""
    before = ring(0.0, np.array([0.0, 0.0, z]))
    after = ring(rotation, np.array([advance, 0.0, z]))
    rows = empty_rows(SWEEP, len(before))
    rows["x0"], rows["y0"], rows["z0"] = before.T
    rows["x1"], rows["y1"], rows["z1"] = after.T
    rows["pair"] = np.arange(len(before)) // 2
    rows["action"], rows["machine_id"], rows["room_mm3"] = action, 1, UNLIMITED_ROOM
    return rows


def ground(**params):
    return Soil(GRID, np.zeros(GRID.shape), SoilParams(**params))


def test_work_of_torque_is_specific_energy_of_milled_volume():
    advance, rotation = 0.002, 0.05
    soil = ground(soil="rock")
    (force,) = soil.step(1, drum(advance, rotation), NOTHING).forces
    energy = rock_specific_energy(soil.soil_types[0].tensile_strength)
    volume = 2.0 * RADIUS * WIDTH * advance
    # Turning from x toward -z is turning about +y; about the axis, not the point of the force.
    arm = np.array([force["x"] - advance, 0.0, force["z"] + 1.0])
    torque = force["ty"] + arm[2] * force["fx"] - arm[0] * force["fz"]
    assert -torque * rotation == pytest.approx(energy * volume, rel=0.05)
    assert force["reaction"] == SoilReaction.MILL
    assert force["fx"] < 0.0  # out of the face
    assert force["fz"] > 0.0  # picks that go down in front are held up


def test_rock_needs_megajoules_per_cubic_metre_and_loam_less():
    assert 5e6 < rock_specific_energy(3e6) < 12e6
    wrenches = [
        ground(soil=kind).step(1, drum(0.002, 0.05), NOTHING).forces[0]["ty"]
        for kind in ("rock", "loam", "dry sand")
    ]
    assert wrenches[0] < 20.0 * wrenches[1] < 0.0
    assert wrenches[1] < 1.5 * wrenches[2] < 0.0


def test_drum_in_the_air_or_moving_back_has_no_resistance():
    assert ground().step(1, drum(0.002, 0.05, z=2.0), NOTHING).forces[0]["fx"] == 0.0
    soil = ground()
    soil.step(1, drum(0.002, 0.05), NOTHING)
    back = drum(-0.002, 0.05)
    force = soil.step(2, back, NOTHING).forces[0]
    assert force["fx"] >= 0.0


def test_drum_excavates_the_swept_part_of_its_cylinder():
    soil = ground()
    before = soil.total_mm3
    step = soil.step(1, drum(0.002, 0.05, z=-0.3), NOTHING)
    excavated = step.conversions[step.conversions["kind"] == ConversionKind.EXCAVATE][
        "volume_mm3"
    ].sum()
    assert before - soil.total_mm3 == excavated
    # The part of the cylinder below the surface, and no column beyond its ends.
    depth = np.linspace(-RADIUS, RADIUS, 2001)
    below = np.clip(0.3 + np.sqrt(RADIUS**2 - depth**2), 0.0, None)
    assert excavated * 1e-9 == pytest.approx(below.mean() * 2 * RADIUS * WIDTH, rel=0.1)


def test_bearing_force_on_stationary_drum_hardly_depends_on_its_angle():
    heights = np.where(GRID.x(np.arange(65))[:, None] > 0.45, 3.0, 0.0) * np.ones(GRID.shape)
    pushes = []
    for angle in (0.0, 0.26, 1.57, 3.1, 4.0):
        soil = Soil(GRID, heights, SoilParams(soil="loam"))
        points = ring(angle, np.array([0.0, 0.0, 1.5]))
        rows = drum(0.0, 0.0, action=SweepAction.COMPACT)
        for end in "01":
            rows[f"x{end}"], rows[f"y{end}"], rows[f"z{end}"] = points.T
        rows["x1"] += 0.02
        forces = soil.step(1, rows, NOTHING).forces
        assert forces["fx"][forces["reaction"] == SoilReaction.CUT].tolist() == [0.0]
        pushes.append(float(forces["fx"][forces["reaction"] == SoilReaction.BEARING].sum()))
    assert max(pushes) < 0.0  # out of the wall
    assert min(pushes) > 2.5 * max(pushes)


def test_stationary_drum_compacts_and_excavates_nothing():
    soil = ground()
    step = soil.step(1, drum(0.0, 0.0, z=0.3, action=SweepAction.COMPACT), NOTHING)
    assert (step.conversions["kind"] != ConversionKind.EXCAVATE).all()
    assert step.rejected_tools == ()
