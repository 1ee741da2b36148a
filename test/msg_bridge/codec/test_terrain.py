"""The terrain is transmitted in the right order; invalid terrain is rejected."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from sensor_msgs.msg import PointField
from support.wire import over_the_wire, raises

from msg_bridge.codec.errors import CodecError
from msg_bridge.codec.point_cloud import from_point_cloud, to_point_cloud
from msg_bridge.codec.terrain import (
    TERRAIN_CELL,
    TerrainMap,
    cells_of_terrain_cloud,
    from_terrain_cloud,
    keyframe_of_cells,
    to_terrain_cloud,
)
from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.rows import MAP_UPDATE, Rows

STAMP = Time(sec=2)


def terrain(rows: int = 3, cols: int = 5, cell: float = 0.2) -> TerrainMap:
    """Return a terrain with a different number in every column and layer, exact in float32."""
    grid = Grid(rows, cols, cell)
    number = np.arange(rows * cols).reshape(rows, cols)
    return TerrainMap(
        Keyframe(
            *(4, 77, grid, -3.0 + 0.25 * number),
            volume_mm3=2**53 - 1 - number.astype(np.int64),
            soil=(255 - number % 256).astype(np.uint8),
            moisture=(number % 101).astype(np.uint8),
            rut_depth=(0.25 * number).astype(np.float32),
        ),
        0.5 * number,
        (number % 3).astype(np.uint8),
        np.where(number % 7 == 0, np.nan, 0.125 * number - 1.0).astype(np.float32),
    )


def transmitted(site: TerrainMap, *, cell: float | None = None) -> TerrainMap:
    return from_terrain_cloud(over_the_wire(to_terrain_cloud(site, "map", STAMP)), cell=cell)


def same(a: TerrainMap, b: TerrainMap) -> bool:
    return (
        (a.keyframe.run_id, a.keyframe.revision, a.keyframe.grid)
        == (b.keyframe.run_id, b.keyframe.revision, b.keyframe.grid)
        and np.array_equal(a.keyframe.elevation, b.keyframe.elevation)
        and np.array_equal(a.loose_depth, b.loose_depth)
        and np.array_equal(a.volume_mm3, b.volume_mm3)
        and np.array_equal(a.surface_material, b.surface_material)
        and np.array_equal(a.moisture, b.moisture)
        and np.array_equal(a.rut_depth, b.rut_depth)
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
def test_terrain_is_transmitted(rows: int, cols: int) -> None:
    site = terrain(rows, cols)
    back = transmitted(site)
    assert same(back, site)
    assert back.volume_mm3.dtype == np.int64
    assert back.keyframe.elevation.dtype == np.float64
    assert back.surface_material.dtype == back.moisture.dtype == back.soil.dtype == np.uint8
    assert back.design_difference.dtype == np.float32


def test_every_moisture_is_transmitted() -> None:
    site = terrain(2, 101)
    assert set(site.moisture.ravel().tolist()) == set(range(101))
    assert same(transmitted(site), site)
    points = from_point_cloud(to_terrain_cloud(site, "map", STAMP), TERRAIN_CELL)
    assert (points["moisture"].min(), points["moisture"].max()) == (0.0, 100.0)


def test_default_layers_are_zeros_without_a_design() -> None:
    site = terrain()
    back = transmitted(bare(site))
    layers = (back.surface_material, back.volume_mm3, back.moisture, back.soil, back.rut_depth)
    for layer in layers:
        assert not layer.any()
        assert layer.shape == (3, 5)
    assert np.isnan(back.design_difference).all()


@pytest.mark.parametrize("cell", [None, 0.2])
def test_keyframe_alone_is_that_of_the_complete_terrain(cell: float | None) -> None:
    site = terrain()
    alone = keyframe_of_cells(
        cells_of_terrain_cloud(to_terrain_cloud(site, "map", STAMP)), cell=cell
    )
    assert same(TerrainMap(alone, *layers_of(site)), site)


def test_arrays_in_column_major_order_are_transmitted() -> None:
    site = terrain()
    frame = site.keyframe
    turned = TerrainMap(
        Keyframe(
            *(4, 77, frame.grid),
            *(np.asfortranarray(layer) for layer in (frame.elevation, frame.volume_mm3)),
            *(np.asfortranarray(layer) for layer in (frame.soil, frame.moisture, frame.rut_depth)),
        ),
        *(np.asfortranarray(layer) for layer in layers_of(site)),
    )
    assert same(transmitted(turned), site)


def test_heights_have_float32_precision() -> None:
    site = terrain()
    site.keyframe.elevation[:] += 1 / 3
    back = transmitted(site).keyframe.elevation
    assert np.array_equal(back, site.keyframe.elevation.astype(np.float32))


def test_largest_run_id_and_revision_are_transmitted() -> None:
    site = terrain()
    frame = Keyframe(2**32 - 1, 2**32 - 2, site.keyframe.grid, site.keyframe.elevation)
    back = transmitted(TerrainMap(frame, site.loose_depth)).keyframe
    assert (back.run_id, back.revision) == (frame.run_id, frame.revision)


def test_decoded_terrain_is_writable() -> None:
    back = transmitted(terrain())
    back.keyframe.elevation[0, 0] = back.loose_depth[0, 0] = back.volume_mm3[0, 0] = 1


@given(
    st.integers(2, 9),
    st.integers(2, 9),
    st.integers(10_000, 999_999),
    st.sampled_from([1e-6, 1e-5, 1e-4, 1e-3]),
)
def test_cell_size_of_six_digits_is_recovered(
    rows: int, cols: int, digits: int, unit: float
) -> None:
    cell = float(f"{digits * unit:.6g}")
    assert transmitted(terrain(rows, cols, cell)).keyframe.grid == Grid(rows, cols, cell)


def test_cell_size_of_a_large_map_is_recovered() -> None:
    assert transmitted(terrain(513, 257, 0.05)).keyframe.grid.cell == 0.05


def test_cell_size_of_many_digits_must_be_given() -> None:
    cell = 0.298_582_141_647_381_4
    assert transmitted(terrain(cell=cell), cell=cell).keyframe.grid.cell == cell
    assert transmitted(terrain(cell=cell)).keyframe.grid.cell == pytest.approx(cell, rel=1e-6)


def test_wrong_cell_size_is_rejected() -> None:
    with raises(ErrorCode.GRID, CodecError):
        transmitted(terrain(), cell=0.25)


def test_cloud_has_a_point_at_the_centre_of_each_column() -> None:
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


def test_fields_shared_with_map_updates() -> None:
    shared = [name for name in TERRAIN_CELL.names or () if name in (MAP_UPDATE.names or ())]
    as_colour = ["moisture", "soil"]  # whole numbers in rows
    numbers = ["volume_mm3", "rut_depth", "revision"]
    assert shared == ["x", "y", "z", "loose_depth", *as_colour, *numbers]
    same_type = [name for name in shared if TERRAIN_CELL[name] == MAP_UPDATE[name]]
    assert [name for name in shared if name not in same_type] == as_colour


def test_point_has_52_bytes_and_display_layers_are_float32() -> None:
    msg = to_terrain_cloud(terrain(), "map", STAMP)
    assert msg.point_step == 52
    kinds = {field.name: field.datatype for field in msg.fields}
    layers = ("loose_depth", "surface_material", "moisture", "soil", "design_difference")
    assert {kinds[name] for name in layers} == {PointField.FLOAT32}


def other_shape(site: TerrainMap) -> TerrainMap:
    return TerrainMap(site.keyframe, site.loose_depth.T)


def other_volume(volume: int) -> Callable[[TerrainMap], TerrainMap]:
    def change(site: TerrainMap) -> TerrainMap:
        site.volume_mm3[1, 1] = volume
        return site

    return change


def other_layer(name: str, layer: NDArray[Any]) -> Callable[[TerrainMap], TerrainMap]:
    def change(site: TerrainMap) -> TerrainMap:
        if name in ("soil", "moisture"):
            return replace(site, keyframe=replace(site.keyframe, **{name: layer}))
        return replace(site, **{name: layer})

    return change


def other_numbers(run_id: int, revision: int) -> Callable[[TerrainMap], TerrainMap]:
    def change(site: TerrainMap) -> TerrainMap:
        frame = Keyframe(run_id, revision, site.keyframe.grid, site.keyframe.elevation)
        return TerrainMap(frame, site.loose_depth)

    return change


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (other_shape, ErrorCode.SHAPE),
        (other_volume(-1), ErrorCode.VALUE),
        (other_volume(2**53), ErrorCode.VALUE),
        (other_layer("soil", np.zeros((5, 3), np.uint8)), ErrorCode.SHAPE),
        (other_layer("soil", np.zeros((3, 5), np.int64)), ErrorCode.VALUE),
        (other_layer("moisture", np.full((3, 5), 101, np.uint8)), ErrorCode.VALUE),
        (other_layer("surface_material", np.full((3, 5), 3, np.uint8)), ErrorCode.VALUE),
        (other_layer("design_difference", np.full((3, 5), np.inf)), ErrorCode.VALUE),
        (other_layer("design_difference", np.zeros((2, 2))), ErrorCode.SHAPE),
        (other_numbers(1, 2**32), ErrorCode.VALUE),
        (other_numbers(-1, 1), ErrorCode.VALUE),
    ],
)
def test_invalid_terrain_is_not_sent(
    change: Callable[[TerrainMap], TerrainMap], code: ErrorCode
) -> None:
    with raises(code, CodecError):
        to_terrain_cloud(change(terrain()), "map", STAMP)


def setting(name: str, value: float, where: tuple[int, int]) -> Callable[[Rows], Rows]:
    def change(cells: Rows) -> Rows:
        cells[name][where] = value
        return cells

    return change


def turned(cells: Rows) -> Rows:
    return cells[::-1, ::-1]


def transposed(cells: Rows) -> Rows:
    return cells.T


def one_row(cells: Rows) -> Rows:
    return cells[:1]


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (setting("z", np.nan, (1, 2)), ErrorCode.VALUE),
        (setting("z", np.inf, (0, 0)), ErrorCode.VALUE),
        (setting("loose_depth", np.nan, (2, 4)), ErrorCode.VALUE),
        (setting("loose_depth", -0.1, (1, 1)), ErrorCode.VALUE),
        (setting("rut_depth", np.nan, (1, 1)), ErrorCode.VALUE),
        (setting("rut_depth", -0.1, (1, 1)), ErrorCode.VALUE),
        (setting("volume_mm3", 0.5, (1, 1)), ErrorCode.VALUE),
        (setting("volume_mm3", -1.0, (1, 1)), ErrorCode.VALUE),
        (setting("volume_mm3", np.nan, (1, 1)), ErrorCode.VALUE),
        (setting("volume_mm3", np.inf, (1, 1)), ErrorCode.VALUE),
        (setting("volume_mm3", 2.0**53, (1, 1)), ErrorCode.VALUE),
        (setting("surface_material", 3.0, (1, 1)), ErrorCode.VALUE),
        (setting("surface_material", np.nan, (1, 1)), ErrorCode.VALUE),
        (setting("moisture", 101.0, (0, 3)), ErrorCode.VALUE),
        (setting("moisture", 0.5, (0, 3)), ErrorCode.VALUE),
        (setting("moisture", np.nan, (0, 3)), ErrorCode.VALUE),
        (setting("soil", 256.0, (2, 0)), ErrorCode.VALUE),
        (setting("soil", 0.5, (2, 0)), ErrorCode.VALUE),
        (setting("soil", -1.0, (2, 0)), ErrorCode.VALUE),
        (setting("design_difference", -np.inf, (2, 0)), ErrorCode.VALUE),
        (setting("revision", 78, (2, 2)), ErrorCode.VALUE),
        (setting("run_id", 5, (0, 1)), ErrorCode.VALUE),
        (setting("x", 0.1, (1, 2)), ErrorCode.GRID),
        (setting("x", np.nan, (0, 0)), ErrorCode.GRID),
        (setting("y", 9.0, (2, 4)), ErrorCode.GRID),
        (turned, ErrorCode.GRID),
        (transposed, ErrorCode.GRID),
        (one_row, ErrorCode.GRID),
    ],
)
@pytest.mark.filterwarnings("error")
def test_invalid_cloud_is_rejected(change: Callable[[Rows], Rows], code: ErrorCode) -> None:
    msg = to_terrain_cloud(terrain(), "map", STAMP)
    cells = from_point_cloud(msg, TERRAIN_CELL).reshape(3, 5).copy()
    cells = change(cells)
    changed = to_point_cloud(cells.reshape(-1), "map", STAMP, height=cells.shape[0])
    with raises(code, CodecError):
        from_terrain_cloud(changed)


def test_other_cloud_is_rejected() -> None:
    with raises(ErrorCode.FIELDS, CodecError):
        from_terrain_cloud(to_point_cloud(np.zeros(4, dtype=MAP_UPDATE), "map", STAMP, height=2))
