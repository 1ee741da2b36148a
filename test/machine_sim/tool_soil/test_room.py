"""A tool reports room only once, although the soil's answers lag."""

import math

import numpy as np
import pytest

from machine_sim.tool_soil.room import ReportedRoom
from msg_bridge.contract.rows import UNLIMITED_ROOM


@pytest.mark.parametrize("lag", [0, 1, 2, 3])
def test_soil_never_gets_more_room_than_there_is(lag: int) -> None:
    rng = np.random.default_rng(lag)
    room, free, reported = ReportedRoom(4), 10**9, []
    for tick in range(300):
        reported.append(room.report(float(free)))
        if tick >= lag:
            # The soil takes all of the room, or part of it.
            taken = reported[tick - lag] if rng.random() < 0.5 else reported[tick - lag] // 3
            free -= taken
            room.receive_answer(lag)
        assert free - sum(reported[max(tick - lag + 1, 0) :]) >= 0
    assert free < 10**6


def test_overfull_tool_has_no_room() -> None:
    assert ReportedRoom(4).report(-5.0) == 0


def test_tool_without_a_limit_reports_none() -> None:
    assert ReportedRoom(4).report(math.inf) == UNLIMITED_ROOM
    assert ReportedRoom(4).report(1e18) < UNLIMITED_ROOM


def test_reset_removes_the_reports_of_an_earlier_session() -> None:
    room = ReportedRoom(4)
    first = room.report(1e9)
    room.report(1e9)
    room.reset()
    assert room.state.size == 0
    assert room.report(1e9) == first
