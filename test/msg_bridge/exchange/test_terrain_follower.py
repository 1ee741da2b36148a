"""Every surface that an observer shows is that of the end of a tick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from support.wire import raises

from msg_bridge.contract.errors import ErrorCode
from msg_bridge.contract.grid import Grid
from msg_bridge.contract.messages import Keyframe, Message, RowChunk, RowRange, SoilHeader, Stream
from msg_bridge.contract.rows import CONVERSION, MAP_UPDATE, Rows, empty_rows
from msg_bridge.exchange.terrain_follower import TerrainFollower

GRID = Grid(5, 4, 1.0)


class Surface:
    """A terrain that changes at random, and the messages of its soil.

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
        """Change some cells in a tick; return its header, and its rows if there are any."""
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


def receive_all(follower: TerrainFollower, *messages: Message | None) -> list[bool]:
    return [follower.receive(message) for message in messages if message is not None]


def shows(follower: TerrainFollower, surface: Surface, tick: int) -> bool:
    """Return whether the follower shows the surface of a tick."""
    revision = surface.revisions[tick]
    same = (follower.elevation == surface.heights[revision]).all()
    return follower.tick == tick and follower.revision == revision and bool(same)


@pytest.fixture
def surface() -> Surface:
    return Surface()


@pytest.fixture
def follower(surface: Surface) -> TerrainFollower:
    """Return a follower with the first keyframe of the run."""
    made = TerrainFollower()
    made.receive(surface.keyframe())
    return made


def test_before_the_first_keyframe_there_is_no_surface(surface: Surface) -> None:
    follower = TerrainFollower()
    assert receive_all(follower, *surface.step(3)) == [False, False]
    assert (follower.tick, follower.grid, follower.run_id) == (-1, None, 0)


def test_keyframe_sets_surface_and_run_and_the_next_header_the_tick(
    surface: Surface, follower: TerrainFollower
) -> None:
    assert (follower.grid, follower.run_id, follower.tick) == (GRID, 3, -1)
    header, _ = surface.step(0)
    assert follower.receive(header)
    assert shows(follower, surface, 1)


@pytest.mark.parametrize("rows_first", [True, False])
def test_tick_advances_when_header_and_rows_have_arrived(
    surface: Surface, follower: TerrainFollower, rows_first: bool
) -> None:
    header, rows = surface.step(5)
    pair: Sequence[Message | None] = (rows, header) if rows_first else (header, rows)
    assert receive_all(follower, *pair) == [False, True]
    assert shows(follower, surface, 1)


def test_messages_in_any_order_lead_to_the_last_surface(
    surface: Surface, follower: TerrainFollower
) -> None:
    messages = [message for _ in range(20) for message in surface.step(4)]
    order = np.random.default_rng(1).permutation(len(messages))
    receive_all(follower, *[messages[i] for i in order])
    assert shows(follower, surface, 20)
    assert follower.gaps == 0


def test_duplicates_and_old_keyframes_change_nothing(
    surface: Surface, follower: TerrainFollower
) -> None:
    messages = [message for _ in range(5) for message in surface.step(4)]
    receive_all(follower, *messages, *messages)
    assert shows(follower, surface, 5)
    first = replace(surface.keyframe(), revision=1, elevation=surface.heights[1])
    assert receive_all(follower, first) == [False]
    assert not follower.resync()
    assert shows(follower, surface, 5)


def test_chunks_are_applied_when_all_are_there(surface: Surface, follower: TerrainFollower) -> None:
    header, rows = surface.step(9)
    assert rows is not None
    pieces = [surface.chunk(rows.rows[i : i + 2]) for i in range(0, 9, 2)]
    assert receive_all(follower, header, *pieces[1:]) == [False] * 5
    assert receive_all(follower, pieces[0]) == [True]
    assert shows(follower, surface, 1)


def test_retransmitted_rows_of_several_ticks_show_no_tick_early(
    surface: Surface, follower: TerrainFollower
) -> None:
    (first, _), (second, _) = surface.step(4), surface.step(4)
    both = surface.chunk(np.concatenate(surface.all_rows))
    assert receive_all(follower, both, first) == [False, True]
    assert shows(follower, surface, 1)
    assert not follower.receive(second)  # its own rows have not come
    follower.receive(surface.chunk(surface.all_rows[1]))
    assert shows(follower, surface, 2)


def test_retransmitted_part_does_not_replace_the_complete_chunk(
    surface: Surface, follower: TerrainFollower
) -> None:
    header, rows = surface.step(6)
    assert rows is not None
    receive_all(follower, rows, surface.chunk(rows.rows[:2]), header)
    assert shows(follower, surface, 1)


def test_keyframe_replaces_lost_rows_after_many_headers(
    surface: Surface, follower: TerrainFollower
) -> None:
    lost, _ = surface.step(3)
    follower.receive(lost)
    for _ in range(60):
        receive_all(follower, *surface.step(2))
    assert follower.tick == -1
    follower.receive(surface.keyframe())
    assert shows(follower, surface, 61)
    assert follower.gaps == 1
    receive_all(follower, *surface.step(2))
    assert shows(follower, surface, 62)


def test_keyframe_replaces_a_lost_header(surface: Surface, follower: TerrainFollower) -> None:
    _, rows = surface.step(3)
    receive_all(follower, rows, *surface.step(3), surface.keyframe())
    assert follower.tick == -1
    assert follower.resync()
    assert shows(follower, surface, 2)


def test_without_a_newer_keyframe_the_follower_waits(
    surface: Surface, follower: TerrainFollower
) -> None:
    follower.receive(surface.step(3)[0])
    assert not follower.resync()
    assert (follower.tick, follower.revision) == (-1, 0)


def test_newer_keyframe_is_not_adopted_if_nothing_is_missing(
    surface: Surface, follower: TerrainFollower
) -> None:
    receive_all(follower, *surface.step(3))
    surface.step(3)
    follower.receive(surface.keyframe())
    assert not follower.resync()
    assert shows(follower, surface, 1)


def test_messages_of_an_old_run_are_ignored(surface: Surface, follower: TerrainFollower) -> None:
    receive_all(follower, *surface.step(3))
    late = surface.step(3)
    restarted = Surface(seed=9, run_id=4)
    follower.receive(restarted.keyframe())
    assert (follower.run_id, follower.tick) == (4, -1)
    assert receive_all(follower, *late, surface.keyframe()) == [False] * 3
    receive_all(follower, *restarted.step(2))
    assert shows(follower, restarted, 1)


def test_rows_of_other_streams_are_ignored(surface: Surface, follower: TerrainFollower) -> None:
    header, _ = surface.step(1)
    other = RowChunk(3, Stream.CONVERSION, 0, 0, empty_rows(CONVERSION, 1))
    assert receive_all(follower, other, header) == [False, False]


def test_cell_outside_of_the_map_is_an_error(surface: Surface, follower: TerrainFollower) -> None:
    header, rows = surface.step(1)
    assert rows is not None
    rows.rows["row"] = GRID.rows
    follower.receive(rows)
    with raises(ErrorCode.OFF_MAP):
        follower.receive(header)


def test_row_numbers_may_pass_2_to_the_32(surface: Surface) -> None:
    wrapping = Surface(first=2**32 - 3)
    follower = TerrainFollower()
    follower.receive(wrapping.keyframe())
    for _ in range(3):
        receive_all(follower, *wrapping.step(5))
    assert shows(follower, wrapping, 3)


@pytest.mark.parametrize("seed", range(10))
def test_over_a_lossy_transport_every_surface_shown_existed(seed: int) -> None:
    rng, surface, follower = np.random.default_rng(seed), Surface(seed), TerrainFollower()
    in_transit: list[Message] = [surface.keyframe()]
    shown = []
    for tick in range(600):
        header, rows = surface.step(int(rng.integers(0, 8)))
        pieces = [surface.chunk(p) for p in np.array_split(rows.rows, 2)] if rows else []
        sent: list[Message] = [header, *(p for p in pieces if p.rows.size)]
        if tick % 50 == 49:
            sent.append(surface.keyframe())
        for message in sent:
            draw = rng.random()
            in_transit += [message] * (0 if draw < 0.02 else 2 if draw > 0.9 else 1)
        order = rng.permutation(len(in_transit))
        late = rng.random(len(in_transit)) < 0.3
        due = [in_transit[i] for i in order if not late[i]]
        in_transit = [in_transit[i] for i in order if late[i]]
        before = follower.tick
        receive_all(follower, *due)
        if tick % 100 == 99:
            follower.resync()
        assert follower.tick >= before
        if follower.tick >= 0:
            assert (follower.elevation == surface.heights[follower.revision]).all()
            assert follower.revision >= surface.revisions[follower.tick]
            shown.append(shows(follower, surface, follower.tick))
    # The surface is newer than the tick only after a keyframe overtook its headers.
    assert np.mean(shown) > 0.8
    receive_all(follower, *in_transit, surface.keyframe(), *surface.step(0))
    follower.resync()
    assert shows(follower, surface, surface.tick)
    assert follower.gaps > 0


def test_run_with_a_smaller_number_can_be_followed() -> None:
    follower, old, new = TerrainFollower(), Surface(run_id=9), Surface(seed=1, run_id=4)
    follower.receive(Keyframe(9, 0, GRID, old.heights[0]))
    follower.receive(Keyframe(4, 0, GRID, new.heights[0]))
    assert follower.run_id == 9
    follower.start_run(4)
    assert follower.run_id == 4
    assert (follower.elevation == new.heights[0]).all()
    follower.start_run(4)
    assert follower.grid is not None


def test_follower_does_not_advance_beyond_its_limit(
    surface: Surface, follower: TerrainFollower
) -> None:
    follower.advance_to(2)
    for _ in range(5):
        header, chunk = surface.step(3)
        receive_all(follower, chunk, header)
    assert shows(follower, surface, 2)
    assert not follower.resync(), "nothing is missing"
    follower.advance_to(4)
    assert shows(follower, surface, 4)
    follower.advance_to(3)
    assert shows(follower, surface, 4), "it does not go back"
    follower.advance_to(None)
    assert shows(follower, surface, 5)
