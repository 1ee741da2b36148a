"""Forces of the soil on tools: earthmoving equation and side plate."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.limit_state import curved_failure_ratio
from support.soil_scenes import (
    NO_DEPOSIT_REQUESTS,
    bucket_sweep,
    flat_soil,
    packed_soil,
    tool_sweep,
)

from msg_bridge.contract.grid import Grid
from msg_bridge.contract.rows import Rows
from soil_sim.soil import Soil
from soil_sim.soils.params import SoilParams
from soil_sim.soils.soil_types import SoilType, load_soil_types
from soil_sim.tool_force import compute_blade_force

KINDS = load_soil_types()
TRAVEL = 0.02
DEPTH = 0.3


def force(soil: Soil, sweep: Rows) -> np.ndarray:
    row = soil.step(0, sweep, NO_DEPOSIT_REQUESTS).forces[0]
    return np.array([row["fx"], row["fy"], row["fz"]], dtype=np.float64)


def plate(rake: float) -> tuple[tuple[float, float], ...]:
    """Return the outline of a plate of 1 m at a rake [deg], behind and above its edge."""
    return ((0.0, 0.0), (-math.cos(math.radians(rake)), math.sin(math.radians(rake))))


def expected(
    name: str,
    rake: float,
    width: float = 1.2,
    depth: float = DEPTH,
    slope: float = 0.0,
    num_ends: float = 2.0,
    kind: SoilType | None = None,
) -> np.ndarray:
    """Return the force on a blade that moves toward +x; rake and slope in degrees.

    That of the trial wedge, times the ratio of exact and plane failure on level ground.
    """
    kind = kind or KINDS[name]
    ratio = curved_failure_ratio(
        math.radians(rake + min(slope, 0.0)),
        math.radians(kind.internal_friction),
        math.radians(kind.tool_friction),
    )
    factor = kind.moisture_strength_factor(kind.moisture)
    found = compute_blade_force(
        width=width,
        depth=depth,
        rake=math.radians(rake),
        gamma=kind.density * 9.81,
        phi=math.radians(kind.internal_friction),
        delta=math.radians(kind.tool_friction),
        cohesion=kind.cohesion * factor,
        adhesion=kind.adhesion * factor,
        slope=math.radians(slope),
        num_ends=num_ends,
    )
    return ratio * np.array([-found.horizontal, 0.0, found.vertical])


def rotated(sweep: Rows, angle: float) -> Rows:
    """Return a sweep rotated about the z axis of the map."""
    sweep = sweep.copy()
    for end in "01":
        x, y = sweep[f"x{end}"].copy(), sweep[f"y{end}"].copy()
        sweep[f"x{end}"] = math.cos(angle) * x - math.sin(angle) * y
        sweep[f"y{end}"] = math.sin(angle) * x + math.cos(angle) * y
    return sweep


def reverse(sweep: Rows) -> Rows:
    """Return a sweep with start and end exchanged."""
    sweep = sweep.copy()
    for axis in "xyz":
        sweep[f"{axis}0"], sweep[f"{axis}1"] = sweep[f"{axis}1"].copy(), sweep[f"{axis}0"].copy()
    return sweep


@pytest.mark.parametrize("rake", [30.0, 60.0, 90.0])
@pytest.mark.parametrize("name", ["gravel", "loam", "dry clay", "wet clay"])
def test_force_on_plate_in_level_soil_is_that_of_earthmoving_equation(name, rake) -> None:
    soil = flat_soil(6.0, 0.2, soil=name)
    soil.relaxation.is_enabled = False
    for tick in range(30):
        x = -0.3 + TRAVEL * tick
        sweep = tool_sweep(plate(rake), (x, 0, -DEPTH), (x + TRAVEL, 0, -DEPTH))
        row = soil.step(tick, sweep, NO_DEPOSIT_REQUESTS).forces[0]
        found = [row["fx"], row["fy"], row["fz"]]
        assert found == pytest.approx(expected(name, rake), rel=0.05, abs=1.0)
        assert row["tz"] == pytest.approx(0.0, abs=1.0)
    assert row["z"] == pytest.approx(-DEPTH * 2 / 3, abs=1e-3)


@pytest.mark.parametrize("degrees", [0, 37, 90, 200, 315])
def test_force_is_against_the_travel(degrees) -> None:
    angle = math.radians(degrees)
    sweep = rotated(tool_sweep(plate(60.0), (0, 0, -DEPTH), (TRAVEL, 0, -DEPTH)), angle)
    found = force(flat_soil(6.0, 0.2, soil="loam"), sweep)
    against, _, up = expected("loam", 60.0)
    direction = [against * math.cos(angle), against * math.sin(angle), up]
    assert found == pytest.approx(direction, rel=0.02, abs=20.0)


def sloping_soil(cell: float, slope: float, yaw: float, name: str) -> Soil:
    """Return soil whose surface rises at a slope in the direction of a yaw, all in degrees."""
    n = int(round(7.0 / cell)) + 1
    grid = Grid(n, n, cell)
    x, y = grid.x(np.arange(n))[:, None], grid.y(np.arange(n))[None, :]
    along = x * math.cos(math.radians(yaw)) + y * math.sin(math.radians(yaw))
    soil = Soil(grid, along * math.tan(math.radians(slope)), SoilParams(soil=name))
    soil.relaxation.is_enabled = False
    return soil


def drag_up_slope(
    cell: float, slope: float, yaw: float, *, name: str = "dry sand", turned: bool = False
) -> np.ndarray:
    """Return forces (ahead, aside, up) in a drag of 0.7 m, shape (ticks, 3).

    The blade cuts `DEPTH` below the slope, level in every tick, or turned with the slope.
    """
    soil = sloping_soil(cell, slope, yaw, name)
    climb, way = math.tan(math.radians(slope)), math.radians(yaw)
    pitch = math.radians(slope) if turned else 0.0
    found = []
    for tick in range(35):
        x = -0.5 + TRAVEL * tick
        rise = TRAVEL * math.tan(pitch)
        z = climb * (x + TRAVEL) - DEPTH
        outline = [
            (
                px * math.cos(pitch) - pz * math.sin(pitch),
                px * math.sin(pitch) + pz * math.cos(pitch),
            )
            for px, pz in plate(60.0)
        ]
        sweep = tool_sweep(outline, (x, 0, z - rise), (x + TRAVEL, 0, z))
        row = soil.step(tick, rotated(sweep, way), NO_DEPOSIT_REQUESTS).forces[0]
        fx, fy = row["fx"], row["fy"]
        ahead = fx * math.cos(way) + fy * math.sin(way)
        found.append((ahead, fy * math.cos(way) - fx * math.sin(way), row["fz"]))
    return np.array(found)


@pytest.mark.parametrize("cell", [0.4, 0.2, 0.1, 0.05])
@pytest.mark.parametrize(
    ("slope", "ratio"), [(-20, 0.60), (-10, 0.79), (0, 1.0), (10, 1.25), (20, 1.58), (30, 2.10)]
)
def test_force_in_a_slope_is_that_of_the_trial_wedge_for_any_cell_and_yaw(cell, slope, ratio):
    level = expected("dry sand", 60.0, num_ends=0.0)
    wide = expected("dry sand", 60.0, slope=slope, num_ends=0.0)
    assert wide[0] == pytest.approx(ratio * level[0], rel=0.01)
    for yaw in (0.0, 33.0, 45.0):
        found = drag_up_slope(cell, slope, yaw)
        assert found == pytest.approx(
            np.broadcast_to(expected("dry sand", 60.0, slope=slope), found.shape),
            rel=0.01,
            abs=30.0,
        )


@pytest.mark.parametrize("slope", [-20, 20])
@pytest.mark.parametrize("name", ["dry sand", "loam"])
def test_blade_turned_with_a_slope_has_the_force_of_the_turned_wedge(name, slope) -> None:
    found = drag_up_slope(0.2, slope, 20.0, name=name, turned=True)
    blade = expected(name, 60.0 - slope, slope=slope)
    assert found == pytest.approx(np.broadcast_to(blade, found.shape), rel=0.01, abs=50.0)


@pytest.mark.parametrize("dive", [10.0, 25.0, 40.0])
@pytest.mark.parametrize("name", ["dry sand", "loam"])
def test_blade_that_dives_has_the_wedge_of_its_angle_to_the_ground(name, dive) -> None:
    dx, dz = TRAVEL * math.cos(math.radians(dive)), -TRAVEL * math.sin(math.radians(dive))
    soil = flat_soil(6.0, 0.2, soil=name)
    soil.relaxation.is_enabled = False
    found = force(soil, tool_sweep(plate(60.0), (0, 0, -DEPTH - dz), (dx, 0, -DEPTH)))
    assert found == pytest.approx(expected(name, 60.0), rel=0.01, abs=30.0)


def test_picks_in_sloping_rock_resist_against_the_travel() -> None:
    level, up = (
        np.array(drag_up_slope(0.2, slope, 0.0, name="rock", turned=True)).mean(axis=0)
        for slope in (0.0, 20.0)
    )
    turn = math.radians(20.0)
    along = up[0] * math.cos(turn) + up[2] * math.sin(turn)
    # The vertical depth is the same, and that perpendicular to the travel is less.
    assert along == pytest.approx(level[0], rel=0.15)
    assert up[2] * math.cos(turn) - up[0] * math.sin(turn) == pytest.approx(level[2], rel=0.15)


@pytest.mark.parametrize(
    ("name", "ratios"), [("dry sand", (1.13, 1.24, 1.36)), ("loam", (1.16, 1.32, 1.46))]
)
def test_soil_beside_a_blade_adds_what_mckyes_and_ali_compute(name, ratios) -> None:
    for depth, ratio in zip((0.1, 0.2, 0.3), ratios, strict=True):
        wide = expected(name, 60.0, depth=depth, num_ends=0.0)
        assert expected(name, 60.0, depth=depth)[0] == pytest.approx(ratio * wide[0], rel=0.02)


@pytest.mark.parametrize(("depth", "fraction"), [(1.0, 0.0), (0.5 * DEPTH, 0.125)])
def test_crescent_beside_a_trench_has_the_volume_that_is_left(depth, fraction) -> None:
    soil = flat_soil(6.0, 0.1, soil="dry sand")
    soil.columns.height[:, soil.grid.y(np.arange(soil.grid.cols)) > 0.65] -= depth
    found = force(soil, tool_sweep(plate(60.0), (0, 0, -DEPTH), (TRAVEL, 0, -DEPTH)))
    sand = expected("dry sand", 60.0, num_ends=1.0 + fraction)
    assert found[0] == pytest.approx(sand[0], rel=0.01)


STROKE = bucket_sweep((0, 0, -DEPTH), (TRAVEL, 0, -DEPTH))


@pytest.mark.parametrize(
    "sweep",
    [
        bucket_sweep((0, 0, 0.1), (TRAVEL, 0, 0.1)),
        bucket_sweep((0, 0, -DEPTH), (0, 0, -DEPTH)),
        bucket_sweep((0, 0, -DEPTH), (0, 0, -DEPTH + TRAVEL)),
        reverse(tool_sweep((*plate(60.0), (0.0, 1.0)), (0, 0, -DEPTH), (TRAVEL, 0, -DEPTH))),
    ],
    ids=["above ground", "at rest", "straight up", "backwards, a blade"],
)
def test_tool_that_does_not_cut_has_no_resistance(sweep) -> None:
    assert not force(flat_soil(6.0, 0.2, soil="loam"), sweep).any()
    assert force(flat_soil(6.0, 0.2, soil="loam"), STROKE)[0] < -1e3


def test_bucket_that_backs_out_of_its_cut_has_no_resistance() -> None:
    soil = flat_soil(6.0, 0.1, soil="dry clay")
    for tick in range(75):
        x = -0.75 + TRAVEL * tick
        soil.step(tick, bucket_sweep((x, 0, -DEPTH), (x + TRAVEL, 0, -DEPTH)), NO_DEPOSIT_REQUESTS)
    back = reverse(bucket_sweep((x, 0, -DEPTH), (x + TRAVEL, 0, -DEPTH)))
    assert abs(force(soil, back)[0]) < 1.0


def test_force_mode_none_gives_no_force() -> None:
    assert not force(flat_soil(6.0, 0.2, soil="loam", force_mode="none"), STROKE).any()


def test_edge_half_in_the_air_has_half_the_force_off_centre() -> None:
    soil = flat_soil(6.0, 0.2, soil="loam")
    sweep = tool_sweep(plate(60.0), (0, 0, -DEPTH), (TRAVEL, 0, -DEPTH), width=1.6)
    whole = force(soil, sweep)
    soil = flat_soil(6.0, 0.2, soil="loam")
    soil.columns.height[:, soil.grid.y(np.arange(soil.grid.cols)) > 0.0] -= 1.0
    row = soil.step(0, sweep, NO_DEPOSIT_REQUESTS).forces[0]
    # The column in the middle is 0.1 m wide on either side.
    assert row["fx"] == pytest.approx(0.5 * whole[0], rel=0.26)
    assert row["y"] == pytest.approx(-0.4, abs=0.11)


def test_loose_clay_resists_less_than_firm_clay() -> None:
    soil = flat_soil(6.0, 0.2, soil="dry clay")
    firm = force(soil, STROKE)[0]
    soil = flat_soil(6.0, 0.2, soil="dry clay")
    columns = soil.columns
    depth = np.int64(0.5 / columns.metres_per_mm3)
    columns.firm -= depth
    columns.loose += depth
    columns.bulk += depth
    assert 0.5 * firm < force(soil, STROKE)[0] < 0.0


def test_packed_soil_resists_as_soil_of_its_density_and_cohesion() -> None:
    loam = KINDS["loam"]
    packed = replace(
        loam,
        density=loam.density / (1.0 - loam.shrinkage),
        cohesion=loam.cohesion * loam.packed_strength,
        adhesion=loam.adhesion,
    )
    sweep = tool_sweep(plate(60.0), (0, 0, -0.1 - DEPTH), (TRAVEL, 0, -0.1 - DEPTH))
    found = force(packed_soil(0.1), sweep)
    assert found == pytest.approx(expected("loam", 60.0, kind=packed), rel=0.02, abs=20.0)
    assert abs(found[0]) > 1.4 * abs(expected("loam", 60.0)[0])
    # 2 cm of sinkage pack 18 cm, and soil below them is not stronger.
    partly = force(packed_soil(0.02), tool_sweep(plate(60.0), (0, 0, -0.32), (TRAVEL, 0, -0.32)))
    assert abs(expected("loam", 60.0)[0]) < abs(partly[0]) < abs(found[0])


def test_rock_resists_with_more_than_a_meganewton() -> None:
    assert force(flat_soil(6.0, 0.2, soil="rock"), STROKE)[0] < -1e6


BOX = ((0.0, 0.0), (-0.8, 0.0), (-0.8, 1.0), (0.0, 1.0))
"""A tool whose side is a rectangle 0.8 m long and 1 m high."""


@pytest.mark.parametrize("way", [TRAVEL, -TRAVEL], ids=["left", "right"])
@pytest.mark.parametrize("name", ["gravel", "loam", "wet clay"])
def test_force_on_side_in_level_soil_is_that_of_earthmoving_equation(name, way) -> None:
    sweep = tool_sweep(BOX, (0, 0, -DEPTH), (0, way, -DEPTH))
    found = force(flat_soil(6.0, 0.2, soil=name), sweep)
    blade = expected(name, 90.0, width=0.8, num_ends=0.0)
    assert found == pytest.approx([0.0, math.copysign(blade[0], -way), 0.0], rel=0.02, abs=1.0)


def test_depth_of_bucket_side_is_that_of_its_outline() -> None:
    deep = 0.6  # of the floor; the back rises, and the rim is above the ground
    found = force(
        flat_soil(6.0, 0.1, soil="gravel"), bucket_sweep((0, 0, -deep), (0, TRAVEL, -deep))
    )
    wall = expected("gravel", 90.0, width=1.0, depth=deep, num_ends=0.0)[0]
    assert wall < found[1] < 0.4 * wall


def test_oblique_travel_has_part_of_the_side_force_symmetric_left_and_right() -> None:
    part = math.sqrt(0.5)
    right, left = (
        force(
            flat_soil(6.0, 0.2, soil="loam"),
            tool_sweep(BOX, (0, 0, -DEPTH), (part * TRAVEL, y * part * TRAVEL, -DEPTH)),
        )
        for y in (-1.0, 1.0)
    )
    assert right == pytest.approx(left * [1.0, -1.0, 1.0], rel=1e-3)
    side = part * expected("loam", 90.0, width=0.8, num_ends=0.0)[0]
    assert left @ [part, part, 0.0] < side  # plus the force on its cutting edge


def test_small_sideways_drift_does_not_change_the_force() -> None:
    drifting = tool_sweep(BOX, (0, 0, -DEPTH), (TRAVEL, 0.01 * TRAVEL, -DEPTH))
    straight = tool_sweep(BOX, (0, 0, -DEPTH), (TRAVEL, 0, -DEPTH))
    found = [force(flat_soil(6.0, 0.2, soil="loam"), sweep) for sweep in (drifting, straight)]
    assert found[0] == pytest.approx(found[1], rel=0.02, abs=300.0)


def test_equal_soils_give_equal_forces() -> None:
    found = [force(flat_soil(6.0, 0.2, soil="loam"), STROKE).tobytes() for _ in range(2)]
    assert found[0] == found[1]
