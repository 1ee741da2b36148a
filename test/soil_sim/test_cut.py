import numpy as np
import pytest
from support.soil_scenes import NO_LANDED, bucket_sweep, flat_soil, scoop

from msg_bridge.contract.rows import Action, Kind
from soil_sim.cut import strips_of
from soil_sim.keypoints import collision_points


def test_a_drag_takes_what_the_bucket_sweeps() -> None:
    # Without slip (steep angle) a 1.2 m bucket dragged 3 m at 0.3 m depth takes a clean slot.
    soil = flat_soil(12.0, 0.1, repose_angle=80.0)
    taken = scoop(soil, depth=0.3, length=3.0)
    slot = 1.2 * (0.3 * 3.0 + 0.215)  # and the bed of the bucket's own profile where it went in
    assert taken / 1e9 == pytest.approx(slot, rel=1e-3)


@pytest.mark.parametrize("cell", [0.4, 0.2, 0.05])
def test_captured_volume_does_not_depend_on_the_grid(cell: float) -> None:
    fine = scoop(flat_soil(9.0, 0.1), depth=0.3, length=3.0)
    assert scoop(flat_soil(9.0, cell), depth=0.3, length=3.0) == pytest.approx(fine, rel=0.01)


def test_captured_volume_does_not_depend_on_speed() -> None:
    slow = scoop(flat_soil(9.0, 0.2), depth=0.3, length=3.0, speed=0.5)
    fast = scoop(flat_soil(9.0, 0.2), depth=0.3, length=3.0, speed=8.0)
    assert fast == pytest.approx(slow, rel=0.01)


def test_conversions_are_what_left_the_columns() -> None:
    soil = flat_soil(6.0, 0.2)
    before = soil.columns.volume(*np.indices(soil.grid.shape))
    start = soil.total_mm3
    step = soil.step(4, bucket_sweep((0, 0, 0.1), (0.05, 0.02, -0.12)), NO_LANDED)
    rows = step.conversions
    assert (rows["kind"] == Kind.EXCAVATE).all()
    assert (rows["tick"] == 4).all()
    assert soil.total_mm3 == start - int(rows["volume_mm3"].sum())
    assert soil.verify()
    lost = before - soil.columns.volume(*np.indices(soil.grid.shape))
    assert np.array_equal(lost[rows["row"], rows["col"]], rows["volume_mm3"])
    assert lost.sum() == rows["volume_mm3"].sum()


def test_excavated_soil_is_found_between_tool_and_surface() -> None:
    soil = flat_soil(6.0, 0.2)
    rows = soil.step(0, bucket_sweep((0, 0, 0.1), (0, 0, -0.2)), NO_LANDED).conversions
    assert rows.size > 5
    assert (rows["z"] < 0).all()
    assert (rows["z"] > -0.2).all()
    assert (np.abs(rows["y"]) <= 0.6).all()


def test_a_tool_above_the_ground_takes_nothing() -> None:
    soil = flat_soil(6.0, 0.2)
    step = soil.step(0, bucket_sweep((0, 0, 0.5), (1, 0, 0.01)), NO_LANDED)
    assert step.conversions.size == 0
    assert step.changed.size == 0
    assert soil.revision == 0


def test_every_tool_that_sweeps_gets_a_force_row() -> None:
    sweep = bucket_sweep((0, 0, 0.1), (0, 0, -0.2))
    forces = flat_soil(6.0, 0.2).step(0, sweep, NO_LANDED).forces
    assert forces.size == 1
    assert forces["source"][0] == 1
    assert not forces["fx"].any()


def test_pressing_does_not_cut() -> None:
    sweep = bucket_sweep((0, 0, 0.1), (0, 0, -0.2))
    sweep["action"] = Action.PRESS
    assert strips_of(sweep).shape[0] == 0
    assert flat_soil(6.0, 0.2).step(0, sweep, NO_LANDED).conversions.size == 0


def test_soil_does_not_slip_into_the_room_a_tool_fills_until_it_has_left() -> None:
    soil = flat_soil(6.0, 0.1)
    soil.step(0, bucket_sweep((0, 0, 0.05), (0, 0, -0.5)), NO_LANDED)
    i, j = int(soil.grid.row(-0.2)), int(soil.grid.col(0.0))
    assert soil.columns.height[i, j] == pytest.approx(-0.5, abs=0.01)
    soil.step(1, bucket_sweep((0, 0, -0.5), (0, 0, -0.5)), NO_LANDED)
    assert soil.columns.height[i, j] == pytest.approx(-0.5, abs=0.01)
    for tick in range(2, 40):
        soil.step(tick, bucket_sweep((0, 0, 2.0), (0, 0, 2.0)), NO_LANDED)
    assert soil.columns.height[i, j] > -0.4
    assert not soil.slip.held.any()


def test_non_finite_key_points_cut_nothing() -> None:
    sweep = bucket_sweep((0, 0, 0.1), (0, 0, -0.2))
    sweep["z1"][3] = np.nan
    soil = flat_soil(6.0, 0.2)
    start = soil.total_mm3
    step = soil.step(0, sweep, NO_LANDED)
    assert np.isfinite(soil.columns.height).all()
    assert soil.total_mm3 == start - int(step.conversions["volume_mm3"].sum())


def test_the_floor_cannot_be_dug() -> None:
    soil = flat_soil(6.0, 0.2, dig_depth=0.15)
    soil.step(0, bucket_sweep((0, 0, 0.1), (0, 0, -5.0)), NO_LANDED)
    assert soil.columns.height.min() >= soil.columns.floor - 1e-9
    assert soil.columns.firm.min() >= 0


def test_reference_mode_has_56_collision_points() -> None:
    points = collision_points(bucket_sweep((0, 0, 0), (0, 0, -0.1)), 8)
    assert points.shape == (56, 3)
    assert np.abs(points[:, 1]).max() == pytest.approx(0.6 - 1.2 / 9, abs=1e-6)


@pytest.mark.parametrize(("cell", "width"), [(0.2, 1.34), (0.1, 1.14)])
def test_reference_mode_lowers_four_grid_points_and_so_cuts_wider_on_coarse_grids(
    cell: float, width: float
) -> None:
    soil = flat_soil(6.0, cell, cut_mode="reference", repose_angle=80.0)
    start = soil.total_mm3
    taken = 0
    widths = []
    for k in range(80):
        y = 0.001 * k  # over all places of the bucket on the grid
        soil = flat_soil(6.0, cell, cut_mode="reference", repose_angle=80.0)
        rows = soil.step(0, bucket_sweep((0, y, 0.1), (0, y, -0.2)), NO_LANDED).conversions
        taken = int(rows["volume_mm3"].sum())
        assert soil.total_mm3 == start - taken
        widths.append(np.unique(rows["col"]).size * cell)
    assert np.mean(widths) == pytest.approx(width, abs=0.1)
