"""Order, rate, pause, seek and loop of playing, and keyframes before everything else."""

from __future__ import annotations

import numpy as np
import pytest

from msg_bridge.contract.errors import ParameterError
from msg_bridge.player.keys import Key, parse_keys
from msg_bridge.player.params import PlayerParams
from msg_bridge.player.playback import Playback

MAP, UPDATES, STATE = "/terrain/map", "/terrain/map_updates", "/state"
START = 10**18
"""Log time of the first message [ns]."""


class Messages:
    """Messages of three topics: a map every 2 s, an update every 0.5 s, a state every 0.1 s."""

    topics = (MAP, UPDATES, STATE)

    def __init__(self) -> None:
        entries = [
            (round(1000 * period * number) + order, topic)
            for topic, (period, order) in enumerate([(2.0, 0), (0.5, 1), (0.1, 2)])
            for number in range(round(10.0 / period))
        ]
        entries.sort()
        self.times = np.array([START + time * 10**6 for time, _ in entries])
        self.topic_numbers = np.array([topic for _, topic in entries])

    @property
    def size(self) -> int:
        return int(self.times.size)

    def of_topic(self, topic: str) -> np.ndarray:
        return np.flatnonzero(self.topic_numbers == self.topics.index(topic))

    def latest(self, topic: str, end: int) -> int | None:
        numbers = self.of_topic(topic)
        numbers = numbers[numbers < end]
        return int(numbers[-1]) if numbers.size else None


MESSAGES = Messages()


def updates_behind(topic: str, number: int, end: int) -> list[int]:
    numbers = MESSAGES.of_topic(UPDATES)
    return numbers[(numbers > number) & (numbers < end)].tolist()


def playback(**options) -> Playback:
    return Playback(MESSAGES, keyframe_topics=[MAP], find_updates=updates_behind, **options)


def play(player: Playback, seconds: float, *, begin: float = 0.0, count: int = 1000) -> list[int]:
    """Return what is taken over some wall time, looked at every 0.05 s."""
    return [
        number
        for step in range(round(seconds / 0.05) + 1)
        for number in player.take(begin + 0.05 * step, count)
    ]


def seconds_of(numbers: list[int]) -> np.ndarray:
    return (MESSAGES.times[numbers] - START) * 1e-9


def test_every_message_is_taken_once_and_in_order() -> None:
    player = playback()
    assert play(player, 12.0) == list(range(MESSAGES.size))
    assert player.is_finished
    assert player.position == pytest.approx(player.duration) == pytest.approx(9.902)


@pytest.mark.parametrize("rate", [0.5, 4.0])
def test_rate_is_kept_and_may_change(rate: float) -> None:
    player = playback(rate=rate)
    taken = play(player, 2.0)
    assert seconds_of(taken)[-1] == pytest.approx(2.0 * rate, abs=0.11)
    player.rate = 1.0
    more = play(player, 1.0, begin=2.0)
    assert seconds_of(more)[-1] == pytest.approx(2.0 * rate + 1.0, abs=0.11)


def test_paused_position_stands_still_and_steps_by_one_message() -> None:
    player = playback(is_paused=True)
    assert play(player, 2.0) == []
    assert [player.take_next() for _ in range(3)] == [[0], [1], [2]]
    player.is_paused = False
    taken = play(player, 1.0, begin=2.0)
    assert taken[0] == 3
    assert seconds_of(taken)[-1] == pytest.approx(1.0, abs=0.11)


@pytest.mark.parametrize("position", [7.25, 3.25])
def test_keyframe_and_its_updates_precede_the_messages_after_a_seek(position: float) -> None:
    player = playback()
    play(player, 5.0)
    player.seek(position)
    keyframes = player.take(5.0, 1000)
    map_time = 2.0 * (position // 2.0)
    expected = [map_time, *np.arange(map_time, position, 0.5) + 0.001]
    assert seconds_of(keyframes) == pytest.approx(expected)
    assert player.position == position
    following = play(player, 1.0, begin=5.0)
    assert following[0] == int(np.searchsorted(seconds_of(list(range(MESSAGES.size))), position))


def test_updates_follow_the_keyframes_also_if_they_are_before_them() -> None:
    player = Playback(
        MESSAGES, keyframe_topics=[MAP], find_updates=lambda *_: [2, 40], is_paused=True
    )
    player.seek(7.25)
    first, *updates = player.take(0.0, 1000)
    assert MESSAGES.topic_numbers[first] == MESSAGES.topics.index(MAP)
    assert updates == [2, 40]


def test_pause_does_not_hold_keyframes_back() -> None:
    player = playback(start=5.0, is_paused=True)
    assert len(player.take(0.0, 1000)) == 1 + 2
    assert player.take(1.0, 1000) == []


def test_only_the_chosen_part_is_played_and_repeated() -> None:
    player = playback(start=3.0, end=4.0, is_looping=True)
    taken = play(player, 3.5)
    once = [3.0, *np.arange(3.0, 4.0, 0.1)]
    times = seconds_of(taken)
    states = times[MESSAGES.topic_numbers[taken] == 2]
    assert len(states) == pytest.approx(3.4 * (len(once) - 1), abs=3)
    assert times.min() >= 2.0  # the keyframe
    assert times.max() <= 4.0
    assert not player.is_finished
    maps = times[MESSAGES.topic_numbers[taken] == 0]
    assert len(maps) == pytest.approx(4 + 3, abs=1)  # each loop has the keyframe and the map of 4 s


def test_position_falls_back_to_what_can_be_published() -> None:
    player = playback(rate=10.0)
    taken = play(player, 0.5, count=2)  # 22 messages of some 60
    assert taken == list(range(len(taken)))
    assert len(taken) == pytest.approx(2 * 10, abs=1)
    assert player.position < 2.0
    assert player.time_behind == pytest.approx(0.5 - player.position / 10.0, abs=0.06)


def test_invalid_values_are_errors() -> None:
    for values in ({"rate": 0.0}, {"start": 5.0, "end": 4.0}, {"include": "("}):
        with pytest.raises(ParameterError):
            PlayerParams(**values)
    for prefix in ("1a b", "a//b", "a-b", "a/2"):
        with pytest.raises(ParameterError, match="prefix is"):
            PlayerParams(prefix=prefix)
    assert PlayerParams(prefix="recorded/").published_name("/soil/tick") == "/recorded/soil/tick"


def test_keys_of_a_terminal_are_parsed() -> None:
    assert parse_keys(" \x1b[C\x1b[Dxsq\x1b[A") == [
        Key.PAUSE,
        Key.FORWARD,
        Key.BACK,
        Key.STEP,
        Key.QUIT,
        Key.FASTER,
    ]
