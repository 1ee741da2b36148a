"""Pictures of a run: they are written, oriented correctly, and have the right volumes."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from earthmoving_sim.coloured_mesh import polygon_mesh
from earthmoving_sim.pictures import (
    SiteRecord,
    Window,
    bucket_path,
    draw_bucket_path,
    draw_cut_fill,
    draw_site_3d,
    shading,
    to_image,
)
from earthmoving_sim.pictures.bucket_path import NEAR_SECTION_M, DigSection, dig_section, heights_at
from earthmoving_sim.pictures.cut_fill import volume_lines
from earthmoving_sim.pictures.map_window import window_around
from earthmoving_sim.pictures.mesh import ground_mesh
from earthmoving_sim.pictures.rasterizer import Camera, rasterize
from earthmoving_sim.pictures.site_3d import best_camera
from earthmoving_sim.pictures.style import nice_length, nice_step, phase_colours
from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.grid import Grid

GRID = Grid(80, 70, 0.25)
ROOF = np.array([[-1.0, -1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]])
DRAWERS = [draw_cut_fill, draw_bucket_path, draw_site_3d]


def site(**changes) -> SiteRecord:
    """Return a site with a pit of 2 x 1 x 0.5 m at x = 4 and a heap of 1 x 1 x 1 m at y = 5."""
    x, y = np.meshgrid(GRID.x(np.arange(GRID.rows)), GRID.y(np.arange(GRID.cols)), indexing="ij")
    before = 0.02 * x
    pit = (np.abs(x - 4.0) < 1.0) & (np.abs(y) < 0.5)
    heap = (np.abs(x) < 0.5) & (np.abs(y - 5.0) < 0.5)
    t = np.linspace(0.0, 1.0, 20)[:, None]
    dig = [5.0, 0.0, 0.2] + t * [-2.0, 0.0, -0.6]
    swing = [3.0, 0.0, 1.5] + t * [-3.0, 5.0, 0.5]
    record = SiteRecord(
        grid=GRID,
        before=before,
        after=before - 0.5 * pit + 1.0 * heap,
        loose_depth=1.0 * heap,
        lip_path=np.concatenate([dig, swing] * 2),
        lip_cycle=np.repeat([1, 2], 40),
        lip_phase=np.tile(np.repeat(["dig", "swing"], 20), 2),
        machine_outline=[("body", np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]))],
        title="Test site",
        machine_mesh=polygon_mesh([((0.91, 0.66, 0.09), ROOF)]),
    )
    return replace(record, **changes)


@pytest.fixture(autouse=True)
def coarse_shading(monkeypatch):
    """Render quickly: no test depends on smooth edges."""
    monkeypatch.setattr(shading, "SUPERSAMPLING", 1)
    monkeypatch.setattr(shading, "SHADOW_PX", 300)


def unchanged() -> SiteRecord:
    record = site()
    return replace(record, after=record.before, loose_depth=np.zeros(GRID.shape))


def without_path(record: SiteRecord) -> SiteRecord:
    return replace(
        record,
        lip_path=np.empty((0, 3)),
        lip_cycle=np.empty(0, dtype=int),
        lip_phase=np.empty(0, dtype=str),
    )


def section_of(record: SiteRecord) -> DigSection:
    section = dig_section(record)
    assert section is not None
    return section


def assert_is_picture(path) -> None:
    with Image.open(path) as image:
        assert image.format == "PNG"
        assert min(image.size) > 500, "large enough to read"
        pixels = np.asarray(image.convert("RGB"))
    colours = pixels[::3, ::3].astype(int) @ [1 << 16, 1 << 8, 1]
    assert len(np.unique(colours)) > 500, "more than a blank page"


@pytest.mark.parametrize("draw", DRAWERS)
def test_picture_is_written_to_its_path(draw, tmp_path):
    path = tmp_path / "new folder" / "picture.png"
    assert draw(site(), path) == path
    assert_is_picture(path)


@pytest.mark.parametrize("draw", DRAWERS)
def test_empty_path_is_drawn(draw, tmp_path):
    assert_is_picture(draw(without_path(site()), tmp_path / "picture.png"))


@pytest.mark.parametrize("draw", DRAWERS)
def test_unchanged_ground_without_machine_is_drawn(draw, tmp_path):
    record = replace(without_path(unchanged()), machine_outline=[], machine_mesh=None)
    assert_is_picture(draw(record, tmp_path / "picture.png"))


@pytest.mark.parametrize("draw", DRAWERS)
def test_flat_map_smaller_than_the_minimum_window_is_drawn(draw, tmp_path):
    flat = np.zeros((20, 12))
    record = site(grid=Grid(20, 12, 0.2), before=flat, after=flat, loose_depth=flat)
    assert_is_picture(draw(record, tmp_path / "picture.png"))


def test_same_record_gives_the_same_3d_picture(tmp_path):
    first = draw_site_3d(site(), tmp_path / "first.png").read_bytes()
    assert draw_site_3d(site(), tmp_path / "second.png").read_bytes() == first


def test_image_has_x_to_the_right_and_y_up():
    grid = Grid(3, 2, 1.0)
    matrix = np.array([[11.0, 12.0], [21.0, 22.0], [31.0, 32.0]])  # row 0 at +x, column 0 at +y
    low_y, high_y = [32.0, 22.0, 12.0], [31.0, 21.0, 11.0]
    np.testing.assert_array_equal(to_image(grid, matrix), [low_y, high_y])


def test_image_of_another_grid_is_rejected():
    with pytest.raises(ParameterError, match="shape"):
        to_image(Grid(3, 2, 1.0), np.zeros((2, 3)))


def test_window_shows_each_column_at_its_own_x_and_y():
    x, y = GRID.x(np.arange(GRID.rows)), GRID.y(np.arange(GRID.cols))
    window = Window(GRID, 3, 20, 5, 9)
    x_image = window.crop(np.broadcast_to(x[:, None], GRID.shape))
    y_image = window.crop(np.broadcast_to(y[None, :], GRID.shape))
    np.testing.assert_allclose(x_image, np.broadcast_to(window.x, (4, 17)))
    np.testing.assert_allclose(y_image, np.broadcast_to(window.y[:, None], (4, 17)))
    half = 0.5 * GRID.cell
    edges = (window.x[0] - half, window.x[-1] + half, window.y[0] - half, window.y[-1] + half)
    assert window.extent == pytest.approx(edges)


def test_window_contains_its_points_and_is_at_least_12_m():
    window = window_around(Grid(257, 257, 0.2), np.array([[3.0, -4.0], [5.0, 7.0]]))
    x_min, x_max, y_min, y_max = window.extent
    assert min(window.size) >= 12.0
    assert x_min < 3.0 < 5.0 < x_max
    assert y_min < -4.0 < 7.0 < y_max


def test_window_at_the_border_stays_on_the_map():
    grid = Grid(257, 257, 0.2)
    window = window_around(grid, np.array([[25.0, -25.0]]))
    _, x_max, y_min, _ = window.extent
    assert min(window.size) >= 12.0
    assert x_max == pytest.approx(25.7)
    assert y_min == pytest.approx(-25.7)


def test_cut_and_fill_are_the_volumes_moved():
    record = site()
    assert record.cut_volume == pytest.approx(2.0 * 1.0 * 0.5)
    assert record.fill_volume == pytest.approx(1.0 * 1.0 * 1.0)
    assert volume_lines(replace(record, after=record.before - 0.01)) == (
        "cut 3.50 m³",
        "fill 0.00 m³",
    )


def test_only_finished_cycles_count():
    assert site().num_cycles == 2, "the path does not say that the last one was not finished"
    record = site(num_finished_cycles=1)
    assert record.num_cycles == 1
    assert [record.is_finished(cycle) for cycle in (1, 2)] == [True, False]


def test_subtitle_of_the_bucket_path_counts_finished_cycles(tmp_path, monkeypatch):
    subtitles = []
    monkeypatch.setattr(bucket_path, "add_title", lambda *args: subtitles.append(args[2]))
    draw_bucket_path(site(num_finished_cycles=1), tmp_path / "picture.png")
    assert subtitles[0].startswith("1 cycle ")


def test_array_of_the_wrong_shape_is_rejected():
    with pytest.raises(ParameterError, match="loose_depth"):
        site(loose_depth=np.zeros((2, 2)))


def test_height_that_is_not_finite_is_rejected():
    with pytest.raises(ParameterError, match="before"):
        site(before=np.full(GRID.shape, np.nan))


def test_machine_origin_is_the_position_or_the_middle_of_the_outline():
    assert site(machine_position=(2.0, 3.0)).machine_origin.tolist() == [2.0, 3.0]
    assert site().machine_origin.tolist() == [0.0, 0.0]


def test_section_is_in_the_direction_of_the_dig():
    assert section_of(site()).azimuth == pytest.approx(0.0)
    beside = site(machine_position=(4.0, -4.0))
    assert section_of(beside).azimuth == pytest.approx(np.pi / 2, abs=0.02)


def test_record_without_dig_has_no_section():
    assert dig_section(without_path(site())) is None


@pytest.mark.parametrize(("side", "cycles"), [(0.9, [1, 2]), (-0.9, [1, 2]), (1.1, [2]), (-3, [2])])
def test_section_is_that_of_the_last_dig_and_of_the_cycles_close_to_it(side, cycles):
    record = site()
    path = record.lip_path + np.outer(record.lip_cycle == 1, [0.0, side * NEAR_SECTION_M, 0.0])
    section = section_of(replace(record, lip_path=path))
    assert section.azimuth == pytest.approx(0.0), "the direction of cycle 2"
    assert section.cycles == cycles


def test_dig_behind_the_machine_is_not_in_the_section():
    record = site()
    path = record.lip_path * np.where(record.lip_cycle == 1, -1.0, 1.0)[:, None]
    assert section_of(replace(record, lip_path=path)).cycles == [2]


def test_side_view_has_distances_along_its_section():
    section = section_of(site(machine_position=(1.0, 0.0)))
    points = np.array([[4.0, 0.4], [3.0, -2.0]])
    np.testing.assert_allclose(section.along(points), [3.0, 2.0])
    np.testing.assert_allclose(section.points((3.0, 2.0)), [[4.0, 0.0], [3.0, 0.0]])


def test_profile_of_a_plane_is_the_plane():
    x, y = np.meshgrid(GRID.x(np.arange(GRID.rows)), GRID.y(np.arange(GRID.cols)), indexing="ij")
    points = np.array([[1.03, -2.2], [-4.41, 3.33]])
    heights = heights_at(GRID, 0.3 * x - 0.1 * y, points)
    np.testing.assert_allclose(heights, points @ [0.3, -0.1])


def test_nearer_triangle_hides_the_farther_one_where_they_overlap():
    far = [[0, 0, 5], [8, 0, 5], [0, 8, 5]]
    near = [[0, 0, 2], [3, 0, 2], [0, 3, 2]]
    points = np.array(far + near, dtype=np.float64)
    faces, depths = rasterize(points, np.arange(6).reshape(2, 3), (10, 10))
    assert (faces[0, 0], faces[1, 5], faces[9, 9]) == (1, 0, -1)
    assert depths[0, 0] == pytest.approx(2.0, abs=1e-6)


def test_camera_at_minus_y_has_x_to_the_right_and_y_as_depth():
    camera = Camera(-np.pi / 2, 0.0)
    np.testing.assert_allclose(
        camera.view(np.eye(3)), [[1, 0, 0], [0, 0, 1], [0, 1, 0]], atol=1e-12
    )


def test_camera_is_on_the_side_of_the_pit():
    """From the other side the wall would hide the pit."""
    x, y = np.meshgrid(GRID.x(np.arange(GRID.rows)), GRID.y(np.arange(GRID.cols)), indexing="ij")
    pit = (np.abs(x - 2.0) < 1.0) & (np.abs(y) < 0.5)
    wall = (np.abs(x) < 0.5) & (np.abs(y) < 3.0)
    record = site(before=0 * x, after=3.0 * wall - 0.5 * pit, machine_mesh=None)
    window = window_around(GRID, record.changed_points)
    camera = best_camera(record, window, ground_mesh(record, window))
    assert camera.toward[0] > 0.0, "the camera is on the pit's side of the wall"


@pytest.mark.parametrize(("span", "step"), [(1.0, 0.1), (1.1, 0.2), (4.0, 0.5), (0.0, 1.0)])
def test_step_is_round_and_gives_at_most_10_steps(span, step):
    assert nice_step(span, 10) == pytest.approx(step)


@pytest.mark.parametrize(("max_length", "length"), [(3.2, 2.0), (5.0, 5.0), (0.9, 0.5)])
def test_length_is_round_and_at_most_the_maximum(max_length, length):
    assert nice_length(max_length) == pytest.approx(length)


def test_phases_of_a_dig_have_different_colours():
    phases = [
        "approach",
        "brace",
        "reach",
        "dig",
        "curl",
        "lift",
        "swing",
        "dump",
        "settle",
        "done",
    ]
    colours = phase_colours(phases)
    assert list(colours) == phases
    assert len(set(colours.values())) == len(phases)
