"""The excavator is driven by the keys of the live page, in a browser."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from support.live_page import LOADED, LivePage
from support.live_site import LiveSite
from support.throttled_relay import ThrottledRelay

from msg_bridge.testing.ros_process import RosProcess

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

ShowPage = Callable[..., LivePage]

MOVING, AT_REST = 0.1, 0.01  # rad/s

PATIENT = 1800.0
"""Timeout of a whole session [s]."""

SIGNS = {
    "arm in": 1.0,
    "arm out": -1.0,
    "boom down": 1.0,
    "boom up": -1.0,
    "bucket curl in": 1.0,
    "bucket dump": -1.0,
    "swing left": 1.0,
}
"""Sign of the joint's velocity in each motion."""

READ_KEYS = """() => Object.fromEntries(
    [...document.querySelectorAll("dialog .lever-label")].map((label) => [
        label.querySelector(".lever-words").textContent,
        label.querySelector("kbd").textContent.toLowerCase(),
    ]))"""
"""Key of each motion, as the help shows it."""


def wait_for_rest(page: LivePage, site: LiveSite) -> None:
    page.wait_until(lambda: abs(site.swing_velocity) < AT_REST, site.spin)


def test_held_key_swings_the_machine_until_it_is_released(
    site: LiveSite, show_page: ShowPage
) -> None:
    page = show_page(site)
    page.take_control()
    with page.held("a"):
        page.wait_until(lambda: site.swing_velocity > MOVING, site.spin)
    wait_for_rest(page, site)


@pytest.mark.parametrize("end", [LivePage.close, LivePage.crash])
def test_page_that_ends_while_it_drives_stops_the_machine(
    site: LiveSite, show_page: ShowPage, end: Callable[[LivePage], None]
) -> None:
    page = show_page(site)
    page.take_control()
    page.page.keyboard.down("a")
    page.wait_until(lambda: site.swing_velocity > MOVING, site.spin)
    end(page)
    site.ros.spin_until(lambda: abs(site.swing_velocity) < AT_REST)


@pytest.mark.parametrize(
    ("end", "message"),
    [
        (RosProcess.kill, "Excavator does not answer"),
        (RosProcess.interrupt, "Excavator has gone"),
    ],
)
def test_end_of_the_machine_node_is_shown(
    site: LiveSite, show_page: ShowPage, end: Callable[[RosProcess], None], message: str
) -> None:
    page = show_page(site)
    page.take_control()
    with page.held("a"):
        page.wait_until(lambda: site.swing_velocity > MOVING, site.spin)
        end(site.machine)
        page.page.get_by_text(message).wait_for(timeout=1e3 * LOADED)


def test_key_of_a_machine_that_another_viewer_drives_has_a_message(
    site: LiveSite, show_page: ShowPage
) -> None:
    first, second = show_page(site), show_page(site)
    first.take_control()
    second.wait_until(lambda: second.has_driver, site.spin)
    with second.held("a"):
        second.page.get_by_test_id("toast-info").wait_for(timeout=1e3 * LOADED)
    assert not second.is_driving


def test_stalled_connection_is_shown_and_its_driver_releases_the_levers(
    site: LiveSite, open_page: Callable[[str], LivePage]
) -> None:
    relay = ThrottledRelay(site.port)
    try:
        page = open_page(f"{site.url.replace(str(site.port), str(relay.port))}?help=no")
        page.wait_until(lambda: page.is_shown, site.spin, LOADED)
        page.take_control()
        banner = page.page.get_by_test_id("banner-connection")
        assert not banner.is_visible()
        with page.held("a"):
            page.wait_until(lambda: site.swing_velocity > MOVING, site.spin)
            relay.bytes_per_second = 1.0  # the way to the page; that of the levers stays open
            page.wait_until(banner.is_visible, site.spin)
            wait_for_rest(page, site)
        assert page.state()["connection"] == "online"
    finally:
        relay.close()


def test_one_of_two_viewers_drives(site: LiveSite, show_page: ShowPage) -> None:
    first, second = show_page(site), show_page(site)
    first.take_control()
    second.wait_until(lambda: second.has_driver, site.spin)
    assert not second.is_driving
    with second.held("a"):
        with first.held("d"):
            first.wait_until(lambda: site.swing_velocity < -MOVING, site.spin)
        wait_for_rest(first, site)
    second.take_control("take-over")
    first.wait_until(lambda: not first.is_driving, site.spin)
    with second.held("a"):
        second.wait_until(lambda: site.swing_velocity > MOVING, site.spin)


class Beginner:
    """Digs by the angles that the page shows, one motion at a time, after reading the help.

    Attributes:
        page: the page.
    """

    def __init__(self, page: LivePage, site: LiveSite) -> None:
        self.page, self._site = page, site
        self._keys: dict[str, str] = {}
        self._wait_until(self._has_read_keys)

    def angle(self, joint: str) -> float:
        """Return the angle that the page shows [deg]."""
        text = self.page.page.get_by_test_id(f"joint-{joint}").inner_text()
        return float(text.replace("\N{MINUS SIGN}", "-").rstrip("°"))

    def move(self, motion: str, joint: str, goal: float) -> None:
        """Hold the key of a motion until a joint is at an angle [deg] or beyond it.

        Where the joint stays at rest, press the key again: a key that is held through a stall of
        the page, of its connection or of the machine moves nothing until it was released.
        """
        while self._is_before(motion, joint, goal):
            self._hold(motion, joint, goal, progress=0.2, patience=2.0)

    def dig(self, motion: str, joint: str, goal: float) -> None:
        """Move a joint through the ground; where it stalls, raise the boom a little."""
        while self._is_before(motion, joint, goal):
            self._hold(motion, joint, goal, progress=2.0, patience=0.8)
            if self._is_before(motion, joint, goal):
                self.move("boom up", "boom", self.angle("boom") - 1.5)

    def _is_before(self, motion: str, joint: str, goal: float) -> bool:
        return SIGNS[motion] * (self.angle(joint) - goal) < 0.0

    def _hold(
        self, motion: str, joint: str, goal: float, *, progress: float, patience: float
    ) -> None:
        """Hold a key until a joint is at its goal, or moves less than `progress` in `patience`.

        Args:
            motion, joint, goal: as those of `move`.
            progress: [deg].
            patience: time that passes on the page [s], so that a slow page has shown the motion.
        """
        with self.page.held(self._keys[motion]):
            while self._is_before(motion, joint, goal):
                last, end = self.angle(joint), self.page.state()["time"] + patience

                def moves(last: float = last) -> bool:
                    return abs(self.angle(joint) - last) > progress

                def is_over(end: float = end) -> bool:
                    return bool(self.page.state()["time"] > end)

                self._wait_until(
                    lambda: not self._is_before(motion, joint, goal) or moves() or is_over()
                )
                if not moves():
                    return

    def _has_read_keys(self) -> bool:
        self._keys = self.page.page.evaluate(READ_KEYS)
        return self._keys.keys() >= SIGNS.keys()

    def _wait_until(self, condition: Callable[[], bool]) -> None:
        self.page.wait_until(condition, self._site.spin, PATIENT)


@pytest.mark.timeout(PATIENT)  # it waits for conditions only, however slow the machine is
def test_beginner_digs_and_piles(site: LiveSite, show_page: ShowPage) -> None:
    page = show_page(site, keep_help=True)
    beginner = Beginner(page, site)
    page.page.keyboard.press("Escape")
    before = site.elevation()
    page.take_control()
    for _ in range(5):
        page.page.keyboard.press("-")  # half of the speed
    beginner.move("arm out", "arm", 62.0)
    beginner.move("bucket dump", "bucket", 52.0)
    beginner.move("boom down", "boom", -20.0)
    beginner.dig("arm in", "arm", 108.0)
    beginner.dig("bucket curl in", "bucket", 110.0)
    beginner.move("boom up", "boom", -36.0)
    beginner.move("swing left", "swing", 60.0)
    beginner.move("bucket dump", "bucket", 10.0)
    page.wait_until(lambda: page.state()["particles"] == 0, site.spin, PATIENT)
    site.wait_for_terrain(page)  # no trail of the digging is left in the texture
    change = page.heights(0, 0, *before.shape) - before
    hole = np.unravel_index(change.argmin(), change.shape)
    rows, cols = np.indices(change.shape)
    is_far = 0.2 * np.hypot(rows - hole[0], cols - hole[1]) > 3.0  # beyond what it pushed
    assert change[hole] < -0.1
    assert change[is_far].max() > 0.1
