"""The surface is that of the topics, in any order of arrival and with losses."""

from __future__ import annotations

import numpy as np
import pytest
from support.surface_scenes import ChangingTerrain

from msg_bridge.contract.errors import ExchangeError
from viewer.scene.terrain_surface import TerrainSurface
from viewer.scene.terrain_tiles import TILE


def assert_equal(surface: TerrainSurface, terrain: ChangingTerrain) -> None:
    assert surface.tiles is not None
    np.testing.assert_array_equal(surface.tiles.layer("height"), terrain.height)
    np.testing.assert_array_equal(
        surface.tiles.layer("loose_depth"), np.rint(1e3 * terrain.loose).astype(np.uint16)
    )
    np.testing.assert_array_equal(surface.tiles.layer("soil"), terrain.soil)
    np.testing.assert_array_equal(surface.tiles.layer("moisture"), terrain.moisture)
    # Padding repeats the edge, so that a page may interpolate.
    tiles = np.frombuffer(surface.tiles.encode(np.arange(surface.tiles.changed.size)), TILE)
    expected = np.pad(terrain.height, ((0, 7), (0, 14)), mode="edge")
    blocks = expected.reshape(3, 16, 4, 16).swapaxes(1, 2).reshape(12, 16, 16)
    np.testing.assert_array_equal(tiles["height"], blocks)


def following(terrain: ChangingTerrain) -> TerrainSurface:
    surface = TerrainSurface()
    surface.start_run(terrain.run_id)
    surface.receive_map(terrain.map())
    return surface


def test_map_updates_are_applied() -> None:
    terrain = ChangingTerrain()
    surface = following(terrain)
    for _ in range(20):
        for chunk in terrain.tick():
            surface.receive_updates(chunk)
    assert surface.gaps == 0
    assert_equal(surface, terrain)


def test_older_map_after_its_updates_changes_nothing() -> None:
    terrain = ChangingTerrain()
    surface = following(terrain)
    for chunk in terrain.tick():
        surface.receive_updates(chunk)
    late = terrain.map()
    for chunk in terrain.tick():
        surface.receive_updates(chunk)
    surface.receive_map(late)
    assert_equal(surface, terrain)


def test_rows_before_the_first_map_and_its_configuration_are_used() -> None:
    terrain = ChangingTerrain()
    first = terrain.map()
    chunks = [chunk for _ in range(5) for chunk in terrain.tick()]
    surface = TerrainSurface()
    surface.start_run(terrain.run_id - 1)
    for chunk in chunks:
        surface.receive_updates(chunk)
    surface.receive_map(first)
    assert surface.tiles is None
    surface.start_run(terrain.run_id)
    assert_equal(surface, terrain)


def test_lost_rows_are_repaired_by_a_map_and_the_rows_after_it() -> None:
    terrain = ChangingTerrain()
    surface = following(terrain)
    for chunk in terrain.tick():
        surface.receive_updates(chunk)
    surface.receive_updates(terrain.tick()[0])  # the second part is lost
    for chunk in terrain.tick():
        surface.receive_updates(chunk)
    repair = terrain.map()
    for chunk in terrain.tick():
        surface.receive_updates(chunk)
    assert surface.gaps == 1
    assert surface.has_gap
    surface.receive_map(repair)
    assert not surface.has_gap
    assert_equal(surface, terrain)


def test_map_that_may_lack_lost_rows_too_does_not_end_the_gap() -> None:
    terrain = ChangingTerrain()
    surface = following(terrain)
    terrain.tick()  # lost
    old = terrain.map()
    terrain.tick()  # lost
    for chunk in terrain.tick():
        surface.receive_updates(chunk)
    surface.receive_map(old)
    assert surface.has_gap
    surface.receive_map(terrain.map())
    assert_equal(surface, terrain)


def test_last_rows_lost_are_repaired_by_the_map_that_follows() -> None:
    terrain = ChangingTerrain()
    surface = following(terrain)
    terrain.tick()  # lost, and nothing changes after it
    assert surface.is_needed(terrain.run_id, terrain.revision)
    surface.receive_map(terrain.map())
    assert_equal(surface, terrain)


def test_rows_sent_again_do_not_undo_later_ones() -> None:
    terrain = ChangingTerrain()
    surface = following(terrain)
    chunks = [chunk for _ in range(50) for chunk in terrain.tick(200)]
    for chunk in chunks:
        surface.receive_updates(chunk)
    surface.receive_updates(chunks[0])
    assert surface.gaps == 0
    assert_equal(surface, terrain)


def test_another_run_begins_without_the_surface_of_the_one_before() -> None:
    terrain = ChangingTerrain()
    surface = following(terrain)
    surface.start_run(terrain.run_id + 1)
    for chunk in terrain.tick():
        surface.receive_updates(chunk)  # of the run before
    assert surface.tiles is None
    restarted = ChangingTerrain(seed=1)
    restarted.run_id = terrain.run_id + 1
    surface.receive_map(restarted.map())
    assert_equal(surface, restarted)


def test_rows_off_the_map_are_rejected() -> None:
    terrain = ChangingTerrain()
    surface = following(terrain)
    chunk = terrain.tick()[0]
    chunk.rows["row"][3] = terrain.grid.rows
    with pytest.raises(ExchangeError, match="outside"):
        surface.receive_updates(chunk)


def test_only_touched_tiles_count_as_changed() -> None:
    terrain = ChangingTerrain()
    surface = following(terrain)
    assert surface.tiles is not None
    counter = surface.tiles.counter
    chunk = terrain.tick(2)[0]
    surface.receive_updates(chunk)
    changed = np.flatnonzero(surface.tiles.changed > counter)
    row, col = int(chunk.rows["row"][0]), int(chunk.rows["col"][0])
    assert changed.tolist() == [(row // 16) * 4 + col // 16]


def test_rows_missed_before_the_first_map_are_repaired_by_a_later_one() -> None:
    terrain = ChangingTerrain()
    first = terrain.map()
    terrain.tick()  # before the subscription
    surface = TerrainSurface()
    surface.start_run(terrain.run_id)
    for chunk in terrain.tick():
        surface.receive_updates(chunk)
    surface.receive_map(first)
    assert surface.has_gap
    surface.receive_map(terrain.map())
    assert_equal(surface, terrain)
