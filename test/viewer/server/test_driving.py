"""One driver at a time, and no motion without one."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from viewer.server.driving import DEAD_MAN_TIME, LEVER_PERIOD, Driving
from viewer.server.page_messages import Drive, RequestRejectedError

BOOM_DOWN = Drive("/m", ("i",), {})


class PublishedLevers:
    """Driving with a clock that the test sets, and what is published."""

    def __init__(self) -> None:
        self.now = 100.0
        self.published: list[tuple[str, Mapping[str, float]]] = []
        self.driving = Driving(lambda *values: self.published.append(values), lambda: self.now)

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds / LEVER_PERIOD)):
            self.now += LEVER_PERIOD
            self.driving.update()

    @property
    def boom(self) -> float:
        return self.published[-1][1]["right_y"]


@pytest.fixture
def levers() -> PublishedLevers:
    made = PublishedLevers()
    made.driving.take(1, "/m")
    return made


def test_first_message_moves_a_lever_at_once(levers: PublishedLevers) -> None:
    levers.driving.drive(1, BOOM_DOWN)
    assert levers.boom > 0.0
    levers.wait(0.24)
    assert levers.boom == 1.0


def test_levers_are_released_once_when_the_driver_is_silent(levers: PublishedLevers) -> None:
    levers.driving.drive(1, BOOM_DOWN)
    levers.wait(DEAD_MAN_TIME - LEVER_PERIOD)
    assert levers.boom > 0.0
    levers.wait(3 * LEVER_PERIOD)
    assert set(levers.published[-1][1].values()) == {0.0}
    count = len(levers.published)
    levers.wait(1.0)
    assert len(levers.published) == count  # other commands of the machine are not disturbed
    assert levers.driving.drivers == {"/m": 1}


def test_gamepad_adds_to_keys_within_the_range(levers: PublishedLevers) -> None:
    levers.driving.drive(1, Drive("/m", (), {"right_y": -0.25}))
    assert levers.boom == -0.25
    levers.driving.drive(1, Drive("/m", ("k",), {"right_y": -0.9}))
    levers.wait(0.2)
    assert levers.boom == -1.0


def test_speed_limits_held_keys(levers: PublishedLevers) -> None:
    levers.driving.set_speed(1, 0.3)
    levers.driving.drive(1, BOOM_DOWN)
    levers.wait(0.28)
    assert levers.boom == pytest.approx(0.3)


def test_second_driver_is_rejected_unless_by_force(levers: PublishedLevers) -> None:
    levers.driving.drive(1, BOOM_DOWN)
    with pytest.raises(RequestRejectedError) as caught:
        levers.driving.take(2, "/m")
    assert caught.value.code == "machine_taken"
    version = levers.driving.version
    levers.driving.take(2, "/m", force=True)
    assert levers.driving.drivers == {"/m": 2}
    assert levers.driving.version > version
    assert set(levers.published[-1][1].values()) == {0.0}  # nothing of the first driver remains
    with pytest.raises(RequestRejectedError):
        levers.driving.drive(1, BOOM_DOWN)


def test_driver_has_one_machine(levers: PublishedLevers) -> None:
    levers.driving.take(1, "/n")
    assert levers.driving.drivers == {"/n": 1}


def test_levers_are_released_when_the_client_goes(levers: PublishedLevers) -> None:
    levers.driving.drive(1, BOOM_DOWN)
    levers.driving.discard(1)
    assert set(levers.published[-1][1].values()) == {0.0}
    assert levers.driving.drivers == {}


def test_emergency_stop_releases_the_levers_and_keeps_the_driver(levers: PublishedLevers) -> None:
    levers.driving.drive(1, BOOM_DOWN)
    levers.driving.stop("/m")
    assert set(levers.published[-1][1].values()) == {0.0}
    levers.wait(0.1)
    assert set(levers.published[-1][1].values()) == {0.0}
    assert levers.driving.drivers == {"/m": 1}


class DelayedDriver:
    """A driver whose clock has an offset, and whose messages may be delayed.

    Attributes:
        codes: codes of the rejected messages.
    """

    def __init__(self, levers: PublishedLevers) -> None:
        self._levers = levers
        self.codes: list[str] = []

    def send(self, *held: str, at: float) -> float:
        """Deliver a message that was sent at a time of the test; return what the boom does."""
        message = Drive("/m", held, {}, time=at - 7000.0)
        try:
            self._levers.driving.drive(1, message)
        except RequestRejectedError as error:
            self.codes.append(error.code)
        return self._levers.boom

    def send_now(self, *held: str) -> float:
        return self.send(*held, at=self._levers.now)


@pytest.fixture
def driver(levers: PublishedLevers) -> DelayedDriver:
    made = DelayedDriver(levers)
    assert made.send_now("i") > 0.0
    return made


def test_levers_that_a_stalled_connection_delivers_late_move_nothing(
    levers: PublishedLevers, driver: DelayedDriver
) -> None:
    stall = levers.now
    levers.wait(3.0)
    assert {driver.send("i", at=stall + 0.05 * i) for i in range(54)} == {0.0}
    assert driver.codes == ["late"] * 54
    assert driver.send_now() == 0.0
    driver.send_now("i")
    levers.wait(0.1)
    assert levers.boom > 0.0


def test_short_delay_is_no_error(levers: PublishedLevers, driver: DelayedDriver) -> None:
    stall = levers.now
    levers.wait(0.6)
    assert driver.send("i", at=stall + 0.1) == 0.0
    assert driver.codes == []


def test_late_release_does_not_answer_an_emergency_stop(
    levers: PublishedLevers, driver: DelayedDriver
) -> None:
    released = levers.now + 0.1
    levers.wait(2.0)
    levers.driving.stop("/m")
    driver.send(at=released)
    driver.send_now("i")
    levers.wait(0.1)
    assert levers.boom == 0.0


def test_slower_connection_drives_again_after_a_rest(
    levers: PublishedLevers, driver: DelayedDriver
) -> None:
    def drive(held: tuple[str, ...], seconds: float) -> float:
        for _ in range(round(seconds / 0.1)):
            levers.wait(0.1)
            driver.send(*held, at=levers.now - 0.8)
        return levers.boom

    assert drive(("i",), 3.0) == 0.0
    assert drive((), 1.2) == 0.0
    assert drive(("i",), 0.2) > 0.0
