"""The published copy of a terrain: it is exact, and stays at a revision while it is held."""

from __future__ import annotations

import numpy as np

from msg_bridge.codec.terrain import TerrainMap, cells_of_terrain
from msg_bridge.codec.terrain_tiles import tile_outlines
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe
from msg_bridge.contract.rows import DEPOSIT_REQUEST, SWEEP, Rows, empty_rows
from soil_sim.node.published_cells import PublishedCells
from soil_sim.soil import Soil


def site() -> Soil:
    """Return level soil of 2 x 2 tiles."""
    grid = Grid(200, 140, 0.2)
    return Soil(grid, np.zeros(grid.shape))


def terrain_of(soil: Soil) -> TerrainMap:
    keyframe = Keyframe(4, soil.revision, soil.grid, soil.columns.height, *soil.layers)
    return TerrainMap(keyframe, soil.columns.loose_depth, soil.columns.material)


def expected_cells(soil: Soil) -> Rows:
    return cells_of_terrain(terrain_of(soil))


def same(published: PublishedCells, expected: Rows) -> bool:
    """Return whether all fields but the revision are equal; tiles have that of their round."""
    names = [name for name in expected.dtype.names or () if name != "revision"]
    return all(
        np.array_equal(published.cells[name], expected[name], equal_nan=True) for name in names
    )


def pour(soil: Soil, published: PublishedCells, x: float, y: float) -> None:
    """Let soil land in a tick, and note the changes."""
    request = empty_rows(DEPOSIT_REQUEST, 1)
    request["machine_id"], request["x"], request["y"], request["z"] = 1, x, y, 1.0
    request["volume_mm3"] = 5 * 10**8
    step = soil.step(soil.revision + 1, empty_rows(SWEEP), request)
    assert step.map_updates.size
    published.update(step.map_updates, soil.columns.material, None)


def test_copy_follows_the_terrain_and_can_be_held() -> None:
    soil = site()
    published = PublishedCells(terrain_of(soil))
    assert same(published, expected_cells(soil))
    assert not published.has_changed
    pour(soil, published, 1.0, 1.0)
    assert published.revision == soil.revision
    assert same(published, expected_cells(soil))
    before, revision = expected_cells(soil), soil.revision
    published.hold()
    pour(soil, published, -3.0, 2.0)
    pour(soil, published, 1.1, 1.0)
    assert same(published, before)
    assert published.revision == revision
    published.release()
    assert same(published, expected_cells(soil))
    assert published.revision == soil.revision


def test_changed_tiles_are_those_with_changed_columns() -> None:
    soil = site()
    published = PublishedCells(terrain_of(soil))
    before = published.cells.copy()
    pour(soil, published, 1.0, 1.0)
    changed = published.take_changed_tiles()
    expected = [
        outline
        for outline in tile_outlines(soil.grid.shape)
        if (
            before[outline.slices]["volume_mm3"] != published.cells[outline.slices]["volume_mm3"]
        ).any()
    ]
    assert changed == expected
    assert published.take_changed_tiles() == []
    assert not published.has_changed
