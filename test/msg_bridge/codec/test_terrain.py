"""The terrain crosses the right way round, and what is no terrain is refused."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2, PointField

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.point_cloud import from_point_cloud, to_point_cloud
from msg_bridge.codec.terrain import (
    TERRAIN_CELL,
    TerrainMap,
    from_terrain_cloud,
    keyframe_from_terrain_cloud,
    to_elevation_image,
    to_map_info,
    to_terrain_cloud,
)
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.rows import MAP_UPDATE, Rows

STAMP = Time(sec=2)


def terrain(rows: int = 3, cols: int = 5, cell: float = 0.2) -> TerrainMap:
    """Another number in every column and layer; exact in float32."""
    grid = Grid(rows, cols, cell)
    number = np.arange(rows * cols).reshape(rows, cols)
    return TerrainMap(
        Keyframe(
            *(4, 77, grid, -3.0 + 0.25 * number),
            volume_mm3=2**53 - 1 - number.astype(np.int64),
            soil=(255 - number % 256).astype(np.uint8),
            moisture=(number % 101).astype(np.uint8),
        ),
        0.5 * number,
        (number % 3).astype(np.uint8),
        np.where(number % 7 == 0, np.nan, 0.125 * number - 1.0).astype(np.float32),
    )


def crossed(site: TerrainMap, *, cell: float | None = None) -> TerrainMap:
    wire = serialize_message(to_terrain_cloud(site, "map", STAMP))
    return from_terrain_cloud(deserialize_message(wire, PointCloud2), cell=cell)


def same(a: TerrainMap, b: TerrainMap) -> bool:
    return (
        (a.keyframe.run_id, a.keyframe.revision, a.keyframe.grid)
        == (b.keyframe.run_id, b.keyframe.revision, b.keyframe.grid)
        and np.array_equal(a.keyframe.elevation, b.keyframe.elevation)
        and np.array_equal(a.loose_depth, b.loose_depth)
        and np.array_equal(a.volume_mm3, b.volume_mm3)
        and np.array_equal(a.surface_material, b.surface_material)
        and np.array_equal(a.moisture, b.moisture)
        and np.array_equal(a.soil, b.soil)
        and np.array_equal(a.design_difference, b.design_difference, equal_nan=True)
    )


def bare(site: TerrainMap) -> TerrainMap:
    frame = site.keyframe
    surface = (frame.run_id, frame.revision, frame.grid, frame.elevation)
    return TerrainMap(Keyframe(*surface), site.loose_depth)


def layers_of(site: TerrainMap) -> tuple[NDArray[Any], ...]:
    return site.loose_depth, site.surface_material, site.design_difference


@pytest.mark.parametrize(("rows", "cols"), [(3, 5), (5, 3), (2, 2), (40, 41)])
def test_terrain_crosses(rows: int, cols: int) -> None:
    site = terrain(rows, cols)
    back = crossed(site)
    assert same(back, site)
    assert back.volume_mm3.dtype == np.int64
    assert back.keyframe.elevation.dtype == np.float64
    assert back.surface_material.dtype == back.moisture.dtype == back.soil.dtype == np.uint8
    assert back.design_difference.dtype == np.float32


def test_every_per_cent_of_moisture_crosses() -> None:
    site = terrain(2, 101)
    assert set(site.moisture.ravel().tolist()) == set(range(101))
    assert same(crossed(site), site)
    points = from_point_cloud(to_terrain_cloud(site, "map", STAMP), TERRAIN_CELL)
    assert (points["moisture"].min(), points["moisture"].max()) == (0.0, 100.0)


def test_layers_that_are_not_given_are_zeros_and_no_design() -> None:
    site = terrain()
    back = crossed(bare(site))
    for layer in (back.surface_material, back.volume_mm3, back.moisture, back.soil):
        assert not layer.any()
        assert layer.shape == (3, 5)
    assert np.isnan(back.design_difference).all()


@pytest.mark.parametrize("cell", [None, 0.2])
def test_the_surface_and_its_soil_are_those_of_the_whole_terrain(cell: float | None) -> None:
    site = terrain()
    alone = keyframe_from_terrain_cloud(to_terrain_cloud(site, "map", STAMP), cell=cell)
    assert same(TerrainMap(alone, *layers_of(site)), site)


def test_arrays_in_column_order_cross() -> None:
    site = terrain()
    frame = site.keyframe
    turned = TerrainMap(
        Keyframe(
            *(4, 77, frame.grid),
            *(np.asfortranarray(layer) for layer in (frame.elevation, frame.volume_mm3)),
            *(np.asfortranarray(layer) for layer in (frame.soil, frame.moisture)),
        ),
        *(np.asfortranarray(layer) for layer in layers_of(site)),
    )
    assert same(crossed(turned), site)


def test_heights_cross_to_float32_precision() -> None:
    site = terrain()
    site.keyframe.elevation[:] += 1 / 3
    back = crossed(site).keyframe.elevation
    assert np.array_equal(back, site.keyframe.elevation.astype(np.float32))


def test_numbers_of_a_long_run_cross() -> None:
    site = terrain()
    frame = Keyframe(2**32 - 1, 2**32 - 2, site.keyframe.grid, site.keyframe.elevation)
    back = crossed(TerrainMap(frame, site.loose_depth)).keyframe
    assert (back.run_id, back.revision) == (frame.run_id, frame.revision)


def test_received_terrain_can_be_worked_on() -> None:
    back = crossed(terrain())
    back.keyframe.elevation[0, 0] = back.loose_depth[0, 0] = back.volume_mm3[0, 0] = 1


@given(
    st.integers(2, 9),
    st.integers(2, 9),
    st.integers(10_000, 999_999),
    st.sampled_from([1e-6, 1e-5, 1e-4, 1e-3]),
)
def test_cell_size_of_six_digits_is_told_from_the_points(
    rows: int, cols: int, digits: int, unit: float
) -> None:
    cell = float(f"{digits * unit:.6g}")
    assert crossed(terrain(rows, cols, cell)).keyframe.grid == Grid(rows, cols, cell)


def test_cell_size_of_a_large_map_is_told_from_the_points() -> None:
    assert crossed(terrain(513, 257, 0.05)).keyframe.grid.cell == 0.05


def test_cell_size_of_many_digits_is_taken_from_who_knows_it() -> None:
    cell = 0.298_582_141_647_381_4
    assert crossed(terrain(cell=cell), cell=cell).keyframe.grid.cell == cell
    assert crossed(terrain(cell=cell)).keyframe.grid.cell == pytest.approx(cell, rel=1e-6)


def test_wrong_cell_size_is_refused() -> None:
    with pytest.raises(CodecError, match=r"not those of 3 x 5 cells of 0\.25 m"):
        crossed(terrain(), cell=0.25)


def test_cloud_has_a_point_for_each_column_where_it_stands() -> None:
    site = terrain()
    grid = site.keyframe.grid
    msg = to_terrain_cloud(site, "map", STAMP)
    assert (msg.height, msg.width) == (grid.rows, grid.cols)
    points = from_point_cloud(msg, TERRAIN_CELL).reshape(msg.height, msg.width)
    for row, col in ((0, 0), (0, 4), (2, 0), (2, 4), (1, 3)):
        point = points[row, col]
        assert point["x"] == np.float32(grid.x(row))
        assert point["y"] == np.float32(grid.y(col))
        assert point["z"] == site.keyframe.elevation[row, col]
        assert point["volume_mm3"] == site.volume_mm3[row, col]
    assert points["x"][0, 0] > points["x"][1, 0]
    assert points["y"][0, 0] > points["y"][0, 1]


def test_fields_shared_with_changed_rows_are_the_same() -> None:
    shared = [name for name in TERRAIN_CELL.names or () if name in (MAP_UPDATE.names or ())]
    as_colour = ["moisture", "soil"]  # whole numbers in rows
    assert shared == ["x", "y", "z", "loose_depth", *as_colour, "volume_mm3", "revision"]
    same_type = [name for name in shared if TERRAIN_CELL[name] == MAP_UPDATE[name]]
    assert [name for name in shared if name not in same_type] == as_colour


def test_a_point_has_48_bytes_and_what_viewers_colour_by_is_float32() -> None:
    msg = to_terrain_cloud(terrain(), "map", STAMP)
    assert msg.point_step == 48
    kinds = {field.name: field.datatype for field in msg.fields}
    layers = ("loose_depth", "surface_material", "moisture", "soil", "design_difference")
    assert {kinds[name] for name in layers} == {PointField.FLOAT32}


def test_image_has_the_matrix_order_of_the_elevation() -> None:
    frame = terrain().keyframe
    msg = to_elevation_image(frame, "map", STAMP)
    assert (msg.height, msg.width, msg.encoding, msg.step) == (3, 5, "32FC1", 20)
    assert np.array_equal(np.frombuffer(msg.data, "<f4").reshape(3, 5), frame.elevation)


def test_info_gives_the_corner_at_minus_x_minus_y_of_the_outer_cell() -> None:
    grid = Grid(3, 5, 0.2)
    info = to_map_info(grid, STAMP)
    assert info.origin.position.x == pytest.approx(grid.x(2) - 0.1)
    assert info.origin.position.y == pytest.approx(grid.y(4) - 0.1)
    assert info.origin.orientation.w == 1.0


def test_info_counts_width_along_x_and_height_along_y() -> None:
    info = to_map_info(Grid(3, 5, 0.2), STAMP)
    assert (info.width, info.height) == (3, 5)
    assert info.resolution == pytest.approx(0.2)


def other_shape(site: TerrainMap) -> TerrainMap:
    return TerrainMap(site.keyframe, site.loose_depth.T)


def other_volume(volume: int) -> Callable[[TerrainMap], TerrainMap]:
    def spoil(site: TerrainMap) -> TerrainMap:
        site.volume_mm3[1, 1] = volume
        return site

    return spoil


def other_layer(name: str, layer: NDArray[Any]) -> Callable[[TerrainMap], TerrainMap]:
    def spoil(site: TerrainMap) -> TerrainMap:
        if name in ("soil", "moisture"):
            return replace(site, keyframe=replace(site.keyframe, **{name: layer}))
        return replace(site, **{name: layer})

    return spoil


def other_numbers(run_id: int, revision: int) -> Callable[[TerrainMap], TerrainMap]:
    def spoil(site: TerrainMap) -> TerrainMap:
        frame = Keyframe(run_id, revision, site.keyframe.grid, site.keyframe.elevation)
        return TerrainMap(frame, site.loose_depth)

    return spoil


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (other_shape, r"loose_depth has shape \(5, 3\)"),
        (other_volume(-1), "columns hold -1 to"),
        (other_volume(2**53), "carries 0 to"),
        (other_layer("soil", np.zeros((5, 3), np.uint8)), r"soil has shape \(5, 3\)"),
        (other_layer("soil", np.zeros((3, 5), np.int64)), "soil is of type int64"),
        (other_layer("moisture", np.full((3, 5), 101, np.uint8)), "moisture .* to 101; .* to 100"),
        (other_layer("surface_material", np.full((3, 5), 3, np.uint8)), "goes to 3"),
        (other_layer("design_difference", np.full((3, 5), np.inf)), "design_difference is inf"),
        (other_layer("design_difference", np.zeros((2, 2))), "design_difference has shape"),
        (other_numbers(1, 2**32), "revision 4294967296 does not fit"),
        (other_numbers(-1, 1), "run_id -1 does not fit"),
    ],
)
def test_terrain_that_no_cloud_can_hold_is_not_sent(
    spoil: Callable[[TerrainMap], TerrainMap], sentence: str
) -> None:
    with pytest.raises(CodecError, match=sentence):
        to_terrain_cloud(spoil(terrain()), "map", STAMP)


def setting(name: str, value: float, where: tuple[int, int]) -> Callable[[Rows], Rows]:
    def spoil(cells: Rows) -> Rows:
        cells[name][where] = value
        return cells

    return spoil


def turned(cells: Rows) -> Rows:
    return cells[::-1, ::-1]


def transposed(cells: Rows) -> Rows:
    return cells.T


def one_row(cells: Rows) -> Rows:
    return cells[:1]


@pytest.mark.parametrize(
    ("spoil", "sentence"),
    [
        (setting("z", np.nan, (1, 2)), "column 1, 2 has no proper elevation; 1 are like it"),
        (setting("z", np.inf, (0, 0)), "column 0, 0 has no proper elevation"),
        (setting("loose_depth", np.nan, (2, 4)), "column 2, 4 has no proper loose_depth"),
        (setting("loose_depth", -0.1, (1, 1)), "no proper loose_depth"),
        (setting("volume_mm3", 0.5, (1, 1)), "no proper volume"),
        (setting("volume_mm3", -1.0, (1, 1)), "no proper volume"),
        (setting("volume_mm3", np.nan, (1, 1)), "no proper volume"),
        (setting("volume_mm3", np.inf, (1, 1)), "no proper volume"),
        (setting("volume_mm3", 2.0**53, (1, 1)), "no proper volume"),
        (setting("surface_material", 3.0, (1, 1)), "column 1, 1 has no proper surface_material"),
        (setting("surface_material", np.nan, (1, 1)), "no proper surface_material"),
        (setting("moisture", 101.0, (0, 3)), "column 0, 3 has no proper moisture"),
        (setting("moisture", 0.5, (0, 3)), "no proper moisture"),
        (setting("moisture", np.nan, (0, 3)), "no proper moisture"),
        (setting("soil", 256.0, (2, 0)), "no proper soil"),
        (setting("soil", 0.5, (2, 0)), "no proper soil"),
        (setting("soil", -1.0, (2, 0)), "no proper soil"),
        (setting("design_difference", -np.inf, (2, 0)), "no proper design_difference"),
        (setting("revision", 78, (2, 2)), "revision is not the same"),
        (setting("run_id", 5, (0, 1)), "run_id is not the same"),
        (setting("x", 0.1, (1, 2)), "x and y are not those of 3 x 5 cells"),
        (setting("x", np.nan, (0, 0)), "x and y are not those of 3 x 5 cells"),
        (setting("y", 9.0, (2, 4)), "x and y are not those of 3 x 5 cells"),
        (turned, "from \\+x, \\+y on"),
        (transposed, "x and y are not those of 5 x 3 cells"),
        (one_row, "at least 2 x 2 columns, not 1 x 5"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_cloud_that_is_no_terrain_is_refused(spoil: Callable[[Rows], Rows], sentence: str) -> None:
    msg = to_terrain_cloud(terrain(), "map", STAMP)
    cells = from_point_cloud(msg, TERRAIN_CELL).reshape(3, 5).copy()
    cells = spoil(cells)
    spoiled = to_point_cloud(cells.reshape(-1), "map", STAMP, height=cells.shape[0])
    with pytest.raises(CodecError, match=sentence):
        from_terrain_cloud(spoiled)


def test_rows_are_no_terrain() -> None:
    with pytest.raises(CodecError, match=r"lacks the fields .surface_material, .* run_id"):
        from_terrain_cloud(to_point_cloud(np.zeros(4, dtype=MAP_UPDATE), "map", STAMP, height=2))
