"""A client ends with the terrain of the scene, whichever frames it could not get."""

from __future__ import annotations

from typing import Any

import msgpack
import numpy as np
import pytest
from support.surface_scenes import ChangingTerrain

from msg_bridge.contract.grid import Grid
from viewer.scene.scene import Scene
from viewer.scene.terrain_tiles import TILE
from viewer.server.encoding import SceneEncoder
from viewer.server.frames import MAX_UNACKNOWLEDGED, FrameStream


class Page:
    """What a page has, from the messages of a FrameStream."""

    def __init__(self, scene: Scene) -> None:
        self.now = 0.0
        self.stream = FrameStream(SceneEncoder(scene), lambda: self.now)
        self.tiles: dict[int, Any] = {}
        self.kinds: list[str] = []
        self.sizes: list[int] = []

    def receive(self, *, acknowledge: bool = True) -> list[str]:
        """Receive what is due; return its types."""
        kinds = []
        for data in self.stream.next_messages():
            message = msgpack.unpackb(data)
            kinds.append(message["type"])
            if message["type"] == "frame":
                self.sizes.append(len(data))
                block = message["tiles"]
                content = np.frombuffer(block["data"], TILE)
                numbers = np.frombuffer(block["index"], "<u4").tolist()
                assert block["count"] == len(numbers) == len(content)
                self.tiles.update(zip(numbers, content, strict=True))
                if acknowledge:
                    assert self.stream.acknowledge(message["seq"])
        self.now += 0.033
        self.kinds += kinds
        return kinds

    def heights(self, grid: Grid) -> Any:
        rows, cols = -(-grid.rows // 16), -(-grid.cols // 16)
        blocks = np.array([self.tiles[n]["height"] for n in range(rows * cols)])
        matrix = blocks.reshape(rows, cols, 16, 16).swapaxes(1, 2).reshape(rows * 16, cols * 16)
        return matrix[: grid.rows, : grid.cols]


def shown(terrain: ChangingTerrain) -> Scene:
    scene = Scene()
    scene.start_run(terrain.run_id)
    scene.terrain.receive_map(terrain.map())
    scene.terrain_changed()
    return scene


def change(scene: Scene, terrain: ChangingTerrain, num_cells: int = 30) -> None:
    for chunk in terrain.tick(num_cells):
        scene.terrain.receive_updates(chunk)
    scene.terrain_changed()


def test_first_frames_bring_the_whole_map_within_the_budget() -> None:
    terrain = ChangingTerrain(grid=Grid(257, 257, 0.2))
    page = Page(shown(terrain))
    assert page.receive() == ["site", "frame"]
    while len(page.tiles) < 17 * 17:
        assert page.receive() == ["frame"]
    assert len(page.sizes) <= 4
    assert max(page.sizes) <= 250_000
    np.testing.assert_array_equal(page.heights(terrain.grid), terrain.height)


def test_client_that_acknowledges_nothing_gets_two_frames_and_later_the_newest() -> None:
    terrain = ChangingTerrain()
    scene = shown(terrain)
    page = Page(scene)
    for _ in range(50):
        page.receive(acknowledge=False)
        change(scene, terrain)
    assert page.kinds.count("frame") == MAX_UNACKNOWLEDGED
    assert not page.stream.acknowledge(99)
    assert page.stream.acknowledge(MAX_UNACKNOWLEDGED)
    assert page.stream.latency > 1.0
    page.receive()
    np.testing.assert_array_equal(page.heights(terrain.grid), terrain.height)


def test_lost_acknowledgement_does_not_end_the_stream() -> None:
    terrain = ChangingTerrain()
    scene = shown(terrain)
    page = Page(scene)
    for _ in range(3):
        page.receive(acknowledge=False)
        change(scene, terrain)
    page.now += 1.0
    assert page.receive() == []
    page.now += 1.0
    assert page.receive() == ["frame"]
    change(scene, terrain)
    assert page.receive() == ["frame"]
    np.testing.assert_array_equal(page.heights(terrain.grid), terrain.height)


@pytest.mark.parametrize("duration", [1.0, 3.0, 7.0])  # of a frame on the link [s]
def test_slow_link_never_has_more_than_four_frames_on_the_way(duration: float) -> None:
    terrain = ChangingTerrain()
    scene = shown(terrain)
    page = Page(scene)
    arrivals: list[float] = []
    most = num_acknowledged = 0
    while page.now < 40.0 * duration:
        change(scene, terrain, 1)
        for kind in page.receive(acknowledge=False):
            if kind == "frame":
                arrivals.append(max([page.now, *arrivals[-1:]]) + duration)
        while num_acknowledged < len(arrivals) and arrivals[num_acknowledged] <= page.now:
            num_acknowledged += 1
            assert page.stream.acknowledge(num_acknowledged)
        most = max(most, len(arrivals) - num_acknowledged)
        page.now += 0.2
    assert num_acknowledged > 30
    assert most <= 4


def test_tiles_beyond_the_budget_follow_though_others_keep_changing() -> None:
    terrain = ChangingTerrain(grid=Grid(513, 513, 0.2))
    scene = shown(terrain)
    page = Page(scene)
    for _ in range(200):
        change(scene, terrain, 400)  # more tiles than fit into a frame
        page.receive()
    for _ in range(20):
        page.receive()
    assert max(page.sizes) <= 250_000
    np.testing.assert_array_equal(page.heights(terrain.grid), terrain.height)


def test_nothing_new_needs_no_frames_but_a_heartbeat() -> None:
    page = Page(shown(ChangingTerrain()))
    page.receive()
    page.kinds.clear()
    for _ in range(60):
        page.receive()
    assert 3 <= page.kinds.count("frame") <= 5


def test_new_run_sends_site_and_all_tiles_again() -> None:
    terrain = ChangingTerrain()
    scene = shown(terrain)
    page = Page(scene)
    page.receive()
    restarted = ChangingTerrain(seed=5)
    restarted.run_id = terrain.run_id + 1
    scene.start_run(restarted.run_id)
    assert page.receive() == ["frame"]
    scene.terrain.receive_map(restarted.map())
    scene.terrain_changed()
    assert page.receive() == ["site", "frame"]
    np.testing.assert_array_equal(page.heights(terrain.grid), restarted.height)


def test_time_before_the_first_tick_is_that_of_the_newest_machine() -> None:
    scene = Scene()
    encoder = SceneEncoder(scene)
    assert msgpack.unpackb(encoder.common()["time"]) is None
    scene.machine("/waiting")
    for name, time in (("/a", 3.14), ("/b", 3.1)):
        scene.machine(name).set_joints(time, ["boom"], [0.0], [], [])
    frame = {name: msgpack.unpackb(value) for name, value in encoder.common().items()}
    assert (frame["time"], frame["tick"], frame["ledger"]) == (3.14, -1, {})
