"""A bag is played, sought and paused by clients, each by its own player."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from support.stream_client import StreamClient
from support.waiting import until

from msg_bridge.bag.mcap_index import index_file
from msg_bridge.bag.reader import BagReadError
from viewer.bag_server import start_bag_server
from viewer.sources.bag_folder import BagFolder, UnknownBagError
from viewer.sources.bag_player import BagPlayer

BAGS = Path(__file__).parents[3] / "bags"


@pytest.fixture
def player():
    made = BagPlayer(BAGS / "format_2")
    yield made
    made.close()


def test_playing_continues_to_the_end_and_begins_again(player: BagPlayer) -> None:
    end = player.timeline().end
    assert end == pytest.approx(60.8)
    until(lambda: player.scene.tick > 0)
    player.set_rate(100.0)
    until(lambda: player.timeline().paused)
    assert player.timeline().time == end
    assert player.scene.tick == 1216
    player.play()
    until(lambda: 0 < player.scene.tick < 1000)


def test_paused_bag_stands_still_at_the_time_sought(player: BagPlayer) -> None:
    player.pause()
    player.seek(30.0)
    until(lambda: player.scene.tick == 600)
    assert player.timeline().time == 30.0
    player.seek(10.0)
    until(lambda: player.scene.tick == 200)
    assert player.timeline().paused


def test_each_client_has_its_own_time() -> None:
    server = start_bag_server(BAGS / "format_2", 0)
    with StreamClient(server.port) as first, StreamClient(server.port, bag="format_2") as second:
        until(lambda: first.frames and second.frames)
        assert first.last("hello")["source"] == "bag"
        first.send(type="playback", action="pause")
        first.send(type="playback", action="seek", value=40.0)
        until(lambda: first.frames[-1]["tick"] == 800)
        assert second.frames[-1]["tick"] < 400
        first.send(type="drive", machine="/excavator", held=[], deflections={})
        until(lambda: first.errors == ["bag"])
        until(lambda: first.last("timeline")["time"] == 40.0)
    server.stop()


def test_only_listed_bags_are_opened(tmp_path: Path) -> None:
    shutil.copytree(BAGS / "format_2", tmp_path / "bags" / "mine")
    (tmp_path / "bags" / "notes").mkdir()
    shutil.copytree(BAGS / "format_2", tmp_path / "other")
    folder = BagFolder(tmp_path / "bags", 1)
    assert folder.names() == ["mine"]
    for name in ("../other", "notes", "", ".", "/etc", "mine/../mine"):
        with pytest.raises(UnknownBagError):
            folder.open(name)
    source = folder.open("mine")
    with pytest.raises(UnknownBagError, match="max_bag_players"):
        folder.open("mine")
    assert source.player is not None
    source.player.close()
    until(lambda: folder.has_free_player)
    assert BagFolder(tmp_path / "missing", 1).names() == []


def test_missing_bag_is_reported_at_the_start(tmp_path: Path) -> None:
    with pytest.raises(BagReadError):
        start_bag_server(tmp_path / "none", 0)


def test_damaged_bag_is_reported_at_the_start(tmp_path: Path) -> None:
    source, file = BAGS / "format_2" / "format_2_0.mcap", tmp_path / "damaged.mcap"
    data = bytearray(source.read_bytes())
    chunk = index_file(0, source).segments[0]
    size = chunk.offset + chunk.length + 11  # of the first message index behind the chunk
    data[size + 1] += 1
    file.write_bytes(data)
    with pytest.raises(BagReadError, match=r"damaged\.mcap is damaged"):
        start_bag_server(file, 0)
