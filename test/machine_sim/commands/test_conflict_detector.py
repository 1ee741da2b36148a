"""Command conflicts: publishers that command the same actuator with different values, in turn."""

from __future__ import annotations

import itertools

import pytest

from machine_sim.commands.conflict_detector import CommandConflict, ConflictDetector
from machine_sim.commands.parser import Setpoint, Setpoints

SWING, BOOM = 0, 1
PERIOD = 0.1


def velocity(value: float, *actuators: int) -> Setpoints:
    return {each: Setpoint(value) for each in actuators or (SWING,)}


class Publisher:
    """Publishes commands with the same setpoints, numbered from `first` on."""

    def __init__(self, topic: str, setpoints: Setpoints, first: int | None = 1) -> None:
        self._topic, self._setpoints = topic, setpoints
        self._numbers = itertools.count(first) if first is not None else itertools.repeat(None)

    def publish(self, detector: ConflictDetector, now: float) -> None:
        detector.record(self._topic, next(self._numbers), self._setpoints, now)


def in_turn(*publishers: Publisher, count: int = 10, period: float = PERIOD) -> ConflictDetector:
    """Let each publisher publish in turn, all within a period, and return the detector."""
    detector = ConflictDetector()
    for k in range(count):
        for publisher in publishers:
            publisher.publish(detector, k * period)
    return detector


@pytest.mark.parametrize("first", [1, 2, 1000])
def test_publishers_of_one_topic_that_alternate_are_a_conflict(first: int) -> None:
    detector = in_turn(
        Publisher("joy", velocity(0.1)), Publisher("joy", velocity(-0.1), first=first)
    )
    assert detector.find(1.0) == CommandConflict((SWING,), ("joy",))


def test_publishers_of_different_topics_that_alternate_are_a_conflict() -> None:
    detector = in_turn(
        Publisher("joint_commands", velocity(0.1, SWING, BOOM)),
        Publisher("joy", velocity(0.0, BOOM)),
    )
    assert detector.find(1.0) == CommandConflict((BOOM,), ("joint_commands", "joy"))


def test_slow_publisher_beside_a_fast_one_is_a_conflict() -> None:
    fast, slow = Publisher("joy", velocity(0.1)), Publisher("joy", velocity(0.0), first=500)
    assert in_turn(*[fast] * 15, slow, count=4, period=0.3).find(1.0) is not None


def test_conflict_ends_after_the_last_change() -> None:
    detector = in_turn(Publisher("joy", velocity(0.1)), Publisher("cmd_vel", velocity(0.0)))
    assert detector.find(3.5) is not None
    assert detector.find(4.5) is None


@pytest.mark.parametrize(
    "publishers",
    [
        pytest.param(
            [Publisher("joy", velocity(0.1, SWING)), Publisher("cmd_vel", velocity(0.2, BOOM))],
            id="of different actuators",
        ),
        pytest.param(
            [Publisher("joy", velocity(0.0)), Publisher("cmd_vel", velocity(0.0))],
            id="of the same value",
        ),
        pytest.param(
            [Publisher("joy", velocity(0.1)), Publisher("joy", {}, first=1000)],
            id="of which one is a joystick at rest",
        ),
        pytest.param(
            [Publisher("joy", velocity(0.1), None), Publisher("joy", velocity(0.2), None)],
            id="of one topic without numbers",
        ),
    ],
)
def test_publishers_are_no_conflict(publishers: list[Publisher]) -> None:
    assert in_turn(*publishers).find(1.0) is None


def test_changing_commands_of_one_publisher_are_no_conflict() -> None:
    detector = ConflictDetector()
    for number in range(100):
        detector.record("joy", 3 * number, velocity(0.01 * number), 0.02 * number)  # some are lost
    assert detector.find(2.0) is None


@pytest.mark.parametrize("topics", [("joy", "joy"), ("joint_commands", "joy")])
def test_publisher_that_hands_over_is_no_conflict(topics: tuple[str, str]) -> None:
    detector = ConflictDetector()
    first, second = (
        Publisher(topic, velocity(value)) for topic, value in zip(topics, (0.1, 0.2), strict=True)
    )
    for start, publisher in ((0.0, first), (0.5, second), (3.0, first), (5.0, second)):
        for k in range(20):
            publisher.publish(detector, start + 0.02 * k)
        assert detector.find(start + 0.5) is None
