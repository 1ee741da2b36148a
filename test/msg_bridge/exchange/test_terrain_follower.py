"""One who looks at the terrain and never answers: what it sees is what there was."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from msg_bridge.contract.errors import ExchangeError
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import (
    Keyframe,
    Message,
    RowChunk,
    RowRange,
    SoilHeader,
    Stream,
)
from msg_bridge.contract.rows import CONVERSION, MAP_UPDATE, Rows, empty_rows
from msg_bridge.exchange.terrain_follower import TerrainFollower

GRID = Grid(5, 4, 1.0)


class Surface:
    """A terrain that changes at random, and the words of a soil on it.

    Attributes:
        heights: of every revision [m].
        revisions: of every tick.
    """

    def __init__(self, seed: int = 0, run_id: int = 3, first: int = 1) -> None:
        self.rng = np.random.default_rng(seed)
        self.run_id = run_id
        self.heights = [self.rng.random(GRID.shape).astype(np.float32).astype(np.float64)]
        self.revisions = [0]
        self.next = first
        self.all_rows: list[Rows] = []

    @property
    def tick(self) -> int:
        return len(self.revisions) - 1

    def step(self, cells: int) -> tuple[SoilHeader, RowChunk | None]:
        """A tick that changes some cells; its header, and its rows if there are any."""
        rows = empty_rows(MAP_UPDATE, cells)
        at = self.rng.choice(GRID.rows * GRID.cols, cells, replace=False)
        rows["row"], rows["col"] = np.unravel_index(at, GRID.shape)
        rows["z"] = self.rng.random(cells)
        rows["seq"] = (self.next + np.arange(cells)) % 2**32
        if cells:
            heights = self.heights[-1].copy()
            heights[rows["row"], rows["col"]] = rows["z"]
            self.heights.append(heights)
        rows["revision"] = len(self.heights) - 1
        span, self.next = RowRange(self.next, cells), self.next + cells
        self.revisions.append(len(self.heights) - 1)
        self.all_rows.append(rows)
        none = RowRange()
        header = SoilHeader(self.run_id, self.tick, self.revisions[-1], none, span, none, ())
        return header, self.chunk(rows) if cells else None

    def chunk(self, rows: Rows) -> RowChunk:
        return RowChunk(self.run_id, Stream.MAP_UPDATE, 0, 0, rows)

    def keyframe(self) -> Keyframe:
        return Keyframe(self.run_id, len(self.heights) - 1, GRID, self.heights[-1])


def give(follower: TerrainFollower, *messages: Message | None) -> list[bool]:
    return [follower.receive(message) for message in messages if message is not None]


def sees(follower: TerrainFollower, surface: Surface, tick: int) -> bool:
    """Whether it shows the surface of a tick."""
    revision = surface.revisions[tick]
    same = (follower.elevation == surface.heights[revision]).all()
    return follower.tick == tick and follower.revision == revision and bool(same)


@pytest.fixture
def surface() -> Surface:
    return Surface()


@pytest.fixture
def follower(surface: Surface) -> TerrainFollower:
    """One that has been given the surface a run begins with."""
    made = TerrainFollower()
    made.receive(surface.keyframe())
    return made


def test_before_the_first_keyframe_nothing_is_known(surface: Surface) -> None:
    follower = TerrainFollower()
    assert give(follower, *surface.step(3)) == [False, False]
    assert (follower.tick, follower.grid, follower.run_id) == (-1, None, 0)


def test_a_keyframe_gives_surface_and_epoch_and_the_next_header_the_tick(
    surface: Surface, follower: TerrainFollower
) -> None:
    assert (follower.grid, follower.run_id, follower.tick) == (GRID, 3, -1)
    header, _ = surface.step(0)
    assert follower.receive(header)
    assert sees(follower, surface, 1)


@pytest.mark.parametrize("rows_first", [True, False])
def test_a_tick_goes_on_once_header_and_rows_are_there(
    surface: Surface, follower: TerrainFollower, rows_first: bool
) -> None:
    header, rows = surface.step(5)
    pair: Sequence[Message | None] = (rows, header) if rows_first else (header, rows)
    assert give(follower, *pair) == [False, True]
    assert sees(follower, surface, 1)


def test_ticks_that_come_in_any_order_end_in_the_last_surface(
    surface: Surface, follower: TerrainFollower
) -> None:
    said = [message for _ in range(20) for message in surface.step(4)]
    order = np.random.default_rng(1).permutation(len(said))
    give(follower, *[said[i] for i in order])
    assert sees(follower, surface, 20)
    assert follower.gaps == 0


def test_what_comes_twice_or_late_changes_nothing(
    surface: Surface, follower: TerrainFollower
) -> None:
    said = [message for _ in range(5) for message in surface.step(4)]
    give(follower, *said, *said)
    assert sees(follower, surface, 5)
    first = replace(surface.keyframe(), revision=1, elevation=surface.heights[1])
    assert give(follower, first) == [False]
    assert not follower.resync()
    assert sees(follower, surface, 5)


def test_rows_cut_in_pieces_count_once_all_are_there(
    surface: Surface, follower: TerrainFollower
) -> None:
    header, rows = surface.step(9)
    assert rows is not None
    pieces = [surface.chunk(rows.rows[i : i + 2]) for i in range(0, 9, 2)]
    assert give(follower, header, *pieces[1:]) == [False] * 5
    assert give(follower, pieces[0]) == [True]
    assert sees(follower, surface, 1)


def test_rows_sent_again_to_a_machine_over_several_ticks_show_no_tick_early(
    surface: Surface, follower: TerrainFollower
) -> None:
    (first, _), (second, _) = surface.step(4), surface.step(4)
    both = surface.chunk(np.concatenate(surface.all_rows))
    assert give(follower, both, first) == [False, True]
    assert sees(follower, surface, 1)
    assert not follower.receive(second)  # its own rows have not come
    follower.receive(surface.chunk(surface.all_rows[1]))
    assert sees(follower, surface, 2)


def test_a_part_sent_again_does_not_take_the_place_of_the_whole(
    surface: Surface, follower: TerrainFollower
) -> None:
    header, rows = surface.step(6)
    assert rows is not None
    give(follower, rows, surface.chunk(rows.rows[:2]), header)
    assert sees(follower, surface, 1)


def test_lost_rows_are_made_good_by_the_next_keyframe_once_patience_ends(
    surface: Surface, follower: TerrainFollower
) -> None:
    lost, _ = surface.step(3)
    follower.receive(lost)
    for _ in range(60):
        give(follower, *surface.step(2))
    assert follower.tick == -1
    follower.receive(surface.keyframe())
    assert sees(follower, surface, 61)
    assert follower.gaps == 1
    give(follower, *surface.step(2))
    assert sees(follower, surface, 62)


def test_a_lost_header_is_made_good_too(surface: Surface, follower: TerrainFollower) -> None:
    _, rows = surface.step(3)
    give(follower, rows, *surface.step(3), surface.keyframe())
    assert follower.tick == -1
    assert follower.resync()
    assert sees(follower, surface, 2)


def test_a_stall_without_a_newer_keyframe_is_waited_out(
    surface: Surface, follower: TerrainFollower
) -> None:
    follower.receive(surface.step(3)[0])
    assert not follower.resync()
    assert (follower.tick, follower.revision) == (-1, 0)


def test_with_nothing_missing_a_newer_keyframe_is_not_taken(
    surface: Surface, follower: TerrainFollower
) -> None:
    give(follower, *surface.step(3))
    surface.step(3)
    follower.receive(surface.keyframe())
    assert not follower.resync()
    assert sees(follower, surface, 1)


def test_a_new_run_begins_anew_and_the_old_one_is_ignored(
    surface: Surface, follower: TerrainFollower
) -> None:
    give(follower, *surface.step(3))
    late = surface.step(3)
    anew = Surface(seed=9, run_id=4)
    follower.receive(anew.keyframe())
    assert (follower.run_id, follower.tick) == (4, -1)
    assert give(follower, *late, surface.keyframe()) == [False] * 3
    give(follower, *anew.step(2))
    assert sees(follower, anew, 1)


def test_rows_of_other_streams_are_ignored(surface: Surface, follower: TerrainFollower) -> None:
    header, _ = surface.step(1)
    stranger = RowChunk(3, Stream.CONVERSION, 0, 0, empty_rows(CONVERSION, 1))
    assert give(follower, stranger, header) == [False, False]


def test_a_cell_off_the_map_is_an_error(surface: Surface, follower: TerrainFollower) -> None:
    header, rows = surface.step(1)
    assert rows is not None
    rows.rows["row"] = GRID.rows
    follower.receive(rows)
    with pytest.raises(ExchangeError, match="off the map"):
        follower.receive(header)


def test_row_numbers_may_pass_2_to_the_32(surface: Surface) -> None:
    wrapping = Surface(first=2**32 - 3)
    follower = TerrainFollower()
    follower.receive(wrapping.keyframe())
    for _ in range(3):
        give(follower, *wrapping.step(5))
    assert sees(follower, wrapping, 3)


@pytest.mark.parametrize("seed", range(10))
def test_over_a_bad_transport_every_surface_shown_is_one_there_was(seed: int) -> None:
    rng, surface, follower = np.random.default_rng(seed), Surface(seed), TerrainFollower()
    on_the_way: list[Message] = [surface.keyframe()]
    shown = []
    for tick in range(600):
        header, rows = surface.step(int(rng.integers(0, 8)))
        pieces = [surface.chunk(p) for p in np.array_split(rows.rows, 2)] if rows else []
        said: list[Message] = [header, *(p for p in pieces if p.rows.size)]
        if tick % 50 == 49:
            said.append(surface.keyframe())
        for message in said:
            fate = rng.random()
            on_the_way += [message] * (0 if fate < 0.02 else 2 if fate > 0.9 else 1)
        order = rng.permutation(len(on_the_way))
        late = rng.random(len(on_the_way)) < 0.3
        due = [on_the_way[i] for i in order if not late[i]]
        on_the_way = [on_the_way[i] for i in order if late[i]]
        before = follower.tick
        give(follower, *due)
        if tick % 100 == 99:
            follower.resync()
        assert follower.tick >= before
        if follower.tick >= 0:
            assert (follower.elevation == surface.heights[follower.revision]).all()
            assert follower.revision >= surface.revisions[follower.tick]
            shown.append(sees(follower, surface, follower.tick))
    # Only a keyframe that has overtaken its headers shows more than the tick says.
    assert np.mean(shown) > 0.8
    give(follower, *on_the_way, surface.keyframe(), *surface.step(0))
    follower.resync()
    assert sees(follower, surface, surface.tick)
    assert follower.gaps > 0


def test_a_run_that_is_named_is_followed_even_if_its_number_is_smaller() -> None:
    follower, old, new = TerrainFollower(), Surface(run_id=9), Surface(seed=1, run_id=4)
    follower.receive(Keyframe(9, 0, GRID, old.heights[0]))
    follower.receive(Keyframe(4, 0, GRID, new.heights[0]))
    assert follower.run_id == 9
    follower.start_run(4)
    assert follower.run_id == 4
    assert (follower.elevation == new.heights[0]).all()
    follower.start_run(4)
    assert follower.grid is not None


def test_one_that_has_a_limit_goes_no_further(surface: Surface, follower: TerrainFollower) -> None:
    follower.advance_to(2)
    for _ in range(5):
        header, chunk = surface.step(3)
        give(follower, chunk, header)
    assert sees(follower, surface, 2)
    assert not follower.resync(), "it lacks nothing"
    follower.advance_to(4)
    assert sees(follower, surface, 4)
    follower.advance_to(3)
    assert sees(follower, surface, 4), "it never goes back"
    follower.advance_to(None)
    assert sees(follower, surface, 5)
