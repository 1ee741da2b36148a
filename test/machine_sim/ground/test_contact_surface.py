import numpy as np
import pytest

from machine_sim.ground.contact_surface import MAX_RISE_SPEED, Ground, GroundError, surface_at
from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.loose_soil import LooseSoil
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.rows import MAP_UPDATE, Rows, empty_rows

GRID = Grid(11, 9, 0.5)


def sloping() -> Ground:
    x, y = GRID.x(np.arange(11))[:, None], GRID.y(np.arange(9))[None, :]
    return Ground(GRID, 0.3 * x - 0.2 * y + 1.0)


def test_height_between_grid_points_is_bilinear() -> None:
    ground = sloping()
    assert ground.height(0.37, -0.81) == pytest.approx(0.3 * 0.37 + 0.2 * 0.81 + 1.0)


def test_height_beyond_the_map_is_that_of_the_edge() -> None:
    ground = sloping()
    assert ground.height(99.0, 0.0) == pytest.approx(ground.height(2.5, 0.0))


@pytest.mark.parametrize(
    ("x", "y", "slopes"),
    [
        (2.5, -2.0, (0.3, -0.2)),  # the corner of the grid points
        (99.0, 0.3, (0.0, -0.2)),
        (-2.51, 0.3, (0.0, -0.2)),
        (0.3, 99.0, (0.3, 0.0)),
        (0.3, -2.01, (0.3, 0.0)),
        (-99.0, 99.0, (0.0, 0.0)),
    ],
)
def test_ground_beyond_the_map_is_level_in_the_direction_of_the_edge(
    x: float, y: float, slopes: tuple[float, float]
) -> None:
    ground = sloping()
    assert surface_at(ground.surface, *ground.frame, x, y)[1:] == pytest.approx(slopes, abs=1e-6)


def test_lowered_cells_fall_at_once_and_raised_ones_at_limited_speed() -> None:
    ground = Ground(GRID, np.zeros(GRID.shape))
    cells = np.array([2, 5])
    ground.set_heights(cells, cells, np.array([-0.4, 0.1]))
    assert ground.surface[2, 2] == -0.4
    assert ground.surface[5, 5] == 0.0
    ground.advance(0.1)
    assert ground.surface[5, 5] == pytest.approx(0.1 * MAX_RISE_SPEED)
    for _ in range(10):
        ground.advance(0.1)
    assert ground.surface[5, 5] == 0.1
    assert np.array_equal(ground.surface, ground.elevation)


def test_rising_cell_that_is_lowered_stops_rising() -> None:
    ground = Ground(GRID, np.zeros(GRID.shape))
    at = np.array([4])
    ground.set_heights(at, at, np.array([0.2]))
    ground.advance(0.1)
    ground.set_heights(at, at, np.array([0.01]))
    ground.advance(1.0)
    assert ground.surface[4, 4] == pytest.approx(0.01)


def test_cell_that_is_updated_again_rises_no_faster() -> None:
    ground = Ground(GRID, np.zeros(GRID.shape))
    at = np.array([4])
    ground.set_heights(at, at, np.array([0.2]))
    ground.set_heights(at, at, np.array([0.3]))
    ground.advance(0.1)
    assert ground.surface[4, 4] == pytest.approx(0.1 * MAX_RISE_SPEED)
    ground.advance(10.0)
    ground.set_heights(at, at, np.array([0.4]))
    ground.advance(0.1)
    assert ground.surface[4, 4] == pytest.approx(0.3 + 0.1 * MAX_RISE_SPEED), "it rises again"


def changed(z: float, soil: int = 0, moisture: int = 0, rut_depth: float = 0.0) -> Rows:
    rows = empty_rows(MAP_UPDATE, 1)
    rows["row"], rows["col"], rows["z"], rows["rut_depth"] = 3, 4, z, rut_depth
    rows["soil"], rows["moisture"] = soil, moisture
    return rows


def test_ground_stores_soil_and_moisture_of_its_surface() -> None:
    ground = Ground(GRID, np.zeros(GRID.shape), soils=[LooseSoil(), LooseSoil(0.2)])
    ground.apply_changes(changed(-0.1, 1, 40))
    assert ground.surface[3, 4] == np.float32(-0.1)
    assert (ground.soil[3, 4], ground.moisture[3, 4]) == (1, 40)
    assert ground.soil.sum() == 1
    of_all = np.full(GRID.shape, 1, dtype=np.uint8)
    ground.apply_keyframe(
        Keyframe(1, 2, GRID, np.zeros(GRID.shape), soil=of_all, moisture=7 * of_all)
    )
    assert (ground.soil == 1).all()
    assert (ground.moisture == 7).all()


def test_unknown_soil_is_rejected() -> None:
    ground = Ground(GRID, np.zeros(GRID.shape))
    with pytest.raises(GroundError, match="soil id 1"):
        ground.apply_changes(changed(-0.1, 1, 0))
    assert ground.surface[3, 4] == 0.0


@pytest.mark.parametrize(("name", "value"), [("z", np.nan), ("row", GRID.rows), ("col", GRID.cols)])
def test_map_updates_with_an_invalid_row_change_nothing(name: str, value: float) -> None:
    ground = sloping()
    before = ground.elevation.copy()
    updates = np.concatenate([changed(-0.1), changed(-0.1)])
    updates[name][1] = value
    with pytest.raises(GroundError, match="off the map or has no finite height"):
        ground.apply_changes(updates)
    assert np.array_equal(ground.elevation, before)
    assert not ground.has_changes


def test_heights_that_are_not_finite_are_rejected_and_change_nothing() -> None:
    ground = sloping()
    before = ground.elevation.copy()
    with pytest.raises(GroundError, match="finite"):
        ground.set_heights(np.array([1]), np.array([1]), np.array([np.nan]))
    assert np.array_equal(ground.elevation, before)
    with pytest.raises(GroundError, match="shape"):
        Ground(GRID, np.zeros((3, 3)))


AT = (3, 4)


def test_rut_lowers_the_contact_surface_but_not_the_undisturbed_one() -> None:
    ground = Ground(GRID, np.zeros(GRID.shape))
    ground.apply_changes(changed(-0.05, rut_depth=0.05))
    assert ground.surface[AT] == pytest.approx(-0.05)
    assert ground.undisturbed_surface[AT] == pytest.approx(0.0, abs=1e-6)
    assert ground.max_sinkage[AT] == pytest.approx(0.05)
    ground.max_sinkage[AT] = 0.08  # of a sole; the soil could not yield as far
    ground.apply_changes(changed(-0.06, rut_depth=0.06))
    assert ground.max_sinkage[AT] == pytest.approx(0.08), "no soil was added or removed"


def test_soil_added_to_a_rut_does_not_lower_the_undisturbed_surface_for_a_moment() -> None:
    """A track that stands in the rut stays where it is."""
    ground = Ground(GRID, np.zeros(GRID.shape))
    ground.apply_changes(changed(-0.05, rut_depth=0.05))
    ground.apply_changes(changed(-0.03, rut_depth=0.03))
    assert ground.undisturbed_surface[AT] == pytest.approx(0.0, abs=1e-6)
    assert ground.surface[AT] == pytest.approx(-0.05)
    assert ground.max_sinkage[AT] == pytest.approx(0.03)
    ground.apply_changes(changed(0.02))
    ground.advance(10.0)
    assert ground.undisturbed_surface[AT] == ground.surface[AT] == pytest.approx(0.02)
    assert ground.max_sinkage[AT] == 0.0


def test_excavation_of_a_rut_leaves_undisturbed_ground() -> None:
    ground = Ground(GRID, np.zeros(GRID.shape))
    ground.apply_changes(changed(-0.05, rut_depth=0.05))
    ground.apply_changes(changed(-0.35))
    assert ground.undisturbed_surface[AT] == ground.surface[AT] == pytest.approx(-0.35)
    assert ground.max_sinkage[AT] == 0.0


def test_keyframe_sets_ruts_like_map_updates() -> None:
    ground = Ground(GRID, np.zeros(GRID.shape))
    elevation, rut_depth = np.zeros(GRID.shape), np.zeros(GRID.shape, dtype=np.float32)
    elevation[AT], rut_depth[AT], elevation[5, 5] = -0.05, 0.05, -0.3
    ground.apply_keyframe(Keyframe(1, 1, GRID, elevation, rut_depth=rut_depth))
    assert ground.undisturbed_surface[AT] == pytest.approx(0.0, abs=1e-6)
    assert ground.max_sinkage[AT] == pytest.approx(0.05)
    assert ground.undisturbed_surface[5, 5] == pytest.approx(-0.3)
    with pytest.raises(ExchangeError, match="below 0"):
        ground.check_keyframe(Keyframe(1, 1, GRID, elevation, rut_depth=-rut_depth))
