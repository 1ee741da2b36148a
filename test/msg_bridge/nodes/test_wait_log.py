"""WaitLog: a wait is in the diagnostics while it lasts, and in the log when it begins and ends."""

from __future__ import annotations

import pytest
from rcl_interfaces.msg import Log

from msg_bridge.nodes.diagnostics import Diagnostics, Level
from msg_bridge.nodes.sim_node import SimNode
from msg_bridge.nodes.wait_log import LOG_PERIOD, REPEAT_PERIOD, REPORT_TIME, Wait, WaitLog
from msg_bridge.testing.ros_context import Ros

SOIL = Wait("the soil", "start it", 0)


class Scene:
    """A node with a clock that the test sets, and its waits."""

    def __init__(self, ros: Ros) -> None:
        self.ros, self.time, self.waits = ros, 1000.0, [SOIL]
        node = ros.add(SimNode, "machine")
        self.diagnostics = Diagnostics(node)
        self.log = WaitLog(node, self.diagnostics, lambda: self.waits, now=lambda: self.time)
        self.lines = ros.collect("/rosout", Log)

    def after(self, seconds: float, *waits: Wait) -> None:
        """Update after some time with other waits."""
        self.log.update()
        self.time += seconds
        self.waits = list(waits)
        self.log.update()

    def logged(self, count: int) -> list[str]:
        """Return the log lines, once there are `count`."""
        self.ros.spin_until(lambda: len(self.lines) >= count)
        return [line.msg for line in self.lines]


@pytest.fixture
def scene(ros: Ros) -> Scene:
    return Scene(ros)


def test_short_wait_is_not_reported(scene: Scene) -> None:
    scene.after(0.9 * REPORT_TIME, SOIL)
    assert scene.diagnostics.report().level is Level.OK
    assert scene.diagnostics.report().values == {"waiting_for": "nothing"}


def test_wait_is_reported_until_it_ends(scene: Scene) -> None:
    scene.after(REPORT_TIME, SOIL)
    report = scene.diagnostics.report()
    assert (report.level, report.message) == (Level.WARN, "waiting for the soil; start it")
    assert report.values == {"waiting_for": "the soil; start it"}
    scene.after(3.0, SOIL)
    scene.after(1.0)
    report = scene.diagnostics.report()
    assert (report.level, report.values) == (Level.OK, {"waiting_for": "nothing"})
    assert scene.logged(2) == [
        "waiting for the soil; start it",
        f"the wait of {REPORT_TIME + 4.0:.1f} s for the soil is over",
    ]


def test_nothing_is_reported_when_the_node_ends(scene: Scene) -> None:
    scene.after(REPORT_TIME, SOIL)
    scene.log.close()
    scene.after(1.0)
    scene.after(LOG_PERIOD, SOIL)
    scene.after(LOG_PERIOD, SOIL)
    report = scene.diagnostics.report()
    assert (report.level, report.values) == (Level.OK, {"waiting_for": "nothing"})
    scene.ros.spin_for(0.3)
    assert scene.logged(1) == ["waiting for the soil; start it"]


def test_progress_begins_another_wait(scene: Scene) -> None:
    for tick in range(5):
        scene.after(0.9 * REPORT_TIME, SOIL._replace(progress=tick))
    assert scene.diagnostics.report().level is Level.OK


def test_wait_continues_when_its_advice_changes(scene: Scene) -> None:
    for attempt in range(5):
        scene.after(0.4 * REPORT_TIME, SOIL._replace(advice=f"start it, {attempt}"))
    report = scene.diagnostics.report()
    assert (report.level, report.message) == (Level.WARN, "waiting for the soil; start it, 4")
    scene.after(0.0)
    assert scene.logged(2) == [
        "waiting for the soil; start it, 2",
        f"the wait of {5 * 0.4 * REPORT_TIME:.1f} s for the soil is over",
    ]


def test_waits_at_the_same_time_are_reported_together(scene: Scene) -> None:
    other = Wait("a command")
    scene.after(0.0, SOIL, other)
    scene.after(REPORT_TIME, SOIL, other)
    assert scene.diagnostics.report().values["waiting_for"] == "the soil; start it and a command"
    scene.after(0.1, other)
    assert scene.diagnostics.report().values["waiting_for"] == "a command"


def test_wait_that_lasts_is_logged_once_per_period(scene: Scene) -> None:
    scene.after(REPORT_TIME, SOIL)
    scene.after(0.9 * LOG_PERIOD, SOIL)
    scene.after(0.2 * LOG_PERIOD, SOIL)
    scene.after(0.2 * LOG_PERIOD)
    lines = scene.logged(3)
    assert [line.endswith("so far)") for line in lines] == [False, True, False]


def test_wait_that_comes_again_soon_is_not_logged_again(scene: Scene) -> None:
    scene.after(REPORT_TIME, SOIL)
    for _ in range(3):
        scene.after(0.1)
        scene.after(0.1, SOIL)
        scene.after(REPORT_TIME, SOIL)
        assert scene.diagnostics.report().level is Level.WARN
    scene.after(REPEAT_PERIOD)
    scene.after(0.1, SOIL)
    scene.after(REPORT_TIME, SOIL)
    assert [line.startswith("waiting") for line in scene.logged(3)] == [True, False, True]
