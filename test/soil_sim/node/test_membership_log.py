"""MembershipLog: one line per machine that joins or leaves; problems until they are over."""

from __future__ import annotations

from typing import Any

import pytest

from soil_sim.node.membership_log import MembershipLog
from soil_sim.node.soil_run import SilentMachine

NAMESPACES = {1: "/excavator", 2: "/dumper"}


class Output:
    """Log lines and diagnostics."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.info = self.warning = self.lines.append
        self.values: dict[str, Any] = {}
        self.problems: dict[str, str] = {}

    def set(self, key: str, value: Any) -> None:
        self.values[key] = value

    def count(self, key: str) -> None:
        self.values[key] = self.values.get(key, 0) + 1

    def problem(self, text: str, *, condition: str) -> None:
        self.problems[condition] = text

    def clear(self, condition: str) -> None:
        self.problems.pop(condition, None)


@pytest.fixture
def output() -> Output:
    return Output()


@pytest.fixture
def log(output: Output) -> MembershipLog:
    return MembershipLog(output, output, NAMESPACES)


def test_each_change_gives_one_line(output: Output, log: MembershipLog) -> None:
    for joined, tick in (((1,), 0), ((1,), 1), ((1, 2), 7), ((2,), 9), ((2,), 20)):
        log.update(joined, tick, {})
    assert output.lines == [
        "/excavator (machine_id 1) joined in tick 0",
        "/dumper (machine_id 2) joined in tick 7",
        "/excavator (machine_id 1) left in tick 9",
    ]
    assert output.problems == {}


def test_machines_join_again_in_a_new_run(output: Output) -> None:
    log = MembershipLog(output, output, {})
    log.update((3,), 4, {})
    log.start_run()
    log.update((3,), 0, {})
    assert output.lines == [f"a machine (machine_id 3) joined in tick {tick}" for tick in (4, 0)]


@pytest.mark.parametrize("end", ["rejoin", "release", "new run"])
def test_dropped_machine_is_a_problem_until_it_is_back_or_released(
    output: Output, log: MembershipLog, end: str
) -> None:
    log.update((2,), 0, {})
    log.drop(SilentMachine(2, 2.5, is_dropped=True), 9)
    log.update((), 10, {})
    assert len(output.lines) == 2  # it has joined and is dropped; it did not leave
    (problem,) = output.problems.values()
    assert "/dumper (machine_id 2)" in problem
    assert output.values["machines_dropped"] == 1
    if end == "rejoin":
        log.update((2,), 11, {})
    elif end == "release":
        log.release()
    else:
        log.start_run()
    assert output.problems == {}


def test_soil_of_an_ended_session_is_reported_with_its_volume(
    output: Output, log: MembershipLog
) -> None:
    log.update((1,), 0, {})
    log.update((1,), 50, {1: 17_300_000_000})
    log.update((1,), 51, {1: 17_300_000_000})
    assert len(output.lines) == 2
    assert "17.300 m3" in output.lines[1]
    assert output.values["soil_of_ended_sessions"] == "17.300 m3 of /excavator (machine_id 1)"
    log.update((1,), 52, {})
    assert output.values["soil_of_ended_sessions"] == "none"
