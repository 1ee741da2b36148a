"""Counters, values, rejections and problems of a node on /diagnostics."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rcl_interfaces.msg import Log
from rclpy.node import Node

from msg_bridge.nodes.diagnostics import REJECTION_WARN_TIME, Diagnostics, Level
from msg_bridge.testing.ros_context import Ros


class Clock:
    """Wall clock that a test sets."""

    def __init__(self) -> None:
        self.time = 1000.0

    def __call__(self) -> float:
        return self.time


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def node(ros: Ros) -> Node:
    return ros.node("soil_sim", namespace="/site")


@pytest.fixture
def diagnostics(node: Node, clock: Clock) -> Diagnostics:
    return Diagnostics(node, "exchange", "excavator 1", now=clock)


def published(ros: Ros, diagnostics: Diagnostics) -> DiagnosticArray:
    received = ros.collect("/diagnostics", DiagnosticArray)
    ros.spin_until(lambda: received)
    return received[-1]


def test_counters_and_values_are_published(ros: Ros, diagnostics: Diagnostics) -> None:
    diagnostics.count("ticks")
    diagnostics.count("ticks", 4)
    diagnostics.set("lateness ms", 1.5)
    array = published(ros, diagnostics)
    (status,) = array.status
    assert status.name == "site/soil_sim: exchange"
    assert status.hardware_id == "excavator 1"
    assert (status.level, status.message) == (DiagnosticStatus.OK, "ok")
    assert {v.key: v.value for v in status.values} == {"ticks": "5", "lateness ms": "1.5"}
    assert array.header.stamp.sec > 0


def test_reason_that_is_not_utf8_is_published(ros: Ros, diagnostics: Diagnostics) -> None:
    diagnostics.reject("the page", "\udcff\nx")
    (status,) = published(ros, diagnostics).status
    assert {v.key: v.value for v in status.values}["last rejected the page"] == "\\udcff\\nx"


def test_diagnostics_are_published_while_simulation_time_stands_still(ros: Ros) -> None:
    node = ros.node("soil_sim", parameters={"use_sim_time": True})
    array = published(ros, Diagnostics(node))
    assert array.status[0].name == "soil_sim"
    assert array.header.stamp.sec == 0


def test_tasks_are_called_before_each_publication(ros: Ros, diagnostics: Diagnostics) -> None:
    diagnostics.add_task(lambda: diagnostics.count("called"))
    received = ros.collect("/diagnostics", DiagnosticArray)
    ros.spin_until(lambda: len(received) >= 2)
    assert [array.status[0].values[0].value for array in received[:2]] == ["1", "2"]


def test_rejection_is_counted_and_sets_level_warn(diagnostics: Diagnostics) -> None:
    diagnostics.reject("cmd_vel", "NaN")
    diagnostics.reject("cmd_vel", "too old")
    report = diagnostics.report()
    assert report.level is Level.WARN
    assert report.message == "messages rejected on cmd_vel"
    assert report.values == {"rejected cmd_vel": "2", "last rejected cmd_vel": "too old"}


def test_rejection_warns_for_a_limited_time(diagnostics: Diagnostics, clock: Clock) -> None:
    diagnostics.reject("cmd_vel", "NaN")
    clock.time += REJECTION_WARN_TIME
    assert diagnostics.report().level is Level.WARN
    clock.time += 0.1
    report = diagnostics.report()
    assert (report.level, report.message) == (Level.OK, "ok")
    assert report.values["rejected cmd_vel"] == "1"


def test_rejections_are_logged_once_a_second_for_each_topic(
    ros: Ros, diagnostics: Diagnostics, clock: Clock
) -> None:
    logged = ros.collect("/rosout", Log)

    def log_lines() -> list[str]:
        return [msg.msg for msg in logged if "rejected" in msg.msg]

    for _ in range(3):
        diagnostics.reject("cmd_vel", "NaN")
    diagnostics.reject("joy", "no axes")
    clock.time += 1.0
    diagnostics.reject("cmd_vel", "too old")
    ros.spin_until(lambda: len(log_lines()) >= 3)
    assert log_lines() == [
        "rejected a message on cmd_vel: NaN",
        "rejected a message on joy: no axes",
        "rejected a message on cmd_vel: too old (2 more rejected since)",
    ]


def test_problem_persists_until_it_is_cleared(diagnostics: Diagnostics) -> None:
    diagnostics.problem("no machine has joined")
    assert diagnostics.report().level is Level.WARN
    diagnostics.problem("the ledger is off by 3 mm3", Level.ERROR)
    diagnostics.reject("joy", "no axes")
    report = diagnostics.report()
    assert report.level is Level.ERROR
    assert report.message == "the ledger is off by 3 mm3; messages rejected on joy"
    diagnostics.clear()
    assert diagnostics.report().level is Level.WARN


def test_problems_of_several_conditions_are_reported_together(diagnostics: Diagnostics) -> None:
    diagnostics.problem("the clock is slow", condition="overload")
    diagnostics.problem("the ledger is off by 3 mm3", Level.ERROR)
    report = diagnostics.report()
    assert report.level is Level.ERROR
    assert report.message == "the ledger is off by 3 mm3; the clock is slow"
    diagnostics.clear()
    assert diagnostics.report().message == "the clock is slow"
    diagnostics.problem("the clock is very slow", condition="overload")
    assert diagnostics.report().message == "the clock is very slow"
    diagnostics.clear("overload")
    assert diagnostics.report().level is Level.OK


def test_persistent_problem_is_reported_behind_what_has_happened(diagnostics: Diagnostics) -> None:
    diagnostics.problem("too slow", Level.ERROR, condition="overload", is_persistent=True)
    diagnostics.problem("two machines touch", condition="contact")
    report = diagnostics.report()
    assert (report.level, report.message) == (Level.ERROR, "two machines touch; too slow")
