"""Controls of the page are reachable in windows of all sizes."""

from __future__ import annotations

import sys
from collections.abc import Callable
from itertools import combinations
from pathlib import Path

import pytest
from support.live_page import LOADED, LivePage
from support.live_site import LiveSite

from msg_bridge.testing.fixtures import StartProcess

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

OpenPage = Callable[..., LivePage]

BAG = Path(__file__).parents[2] / "bags/format_2"

PHONES = [(360, 740), (320, 480), (375, 667), (568, 320), (667, 375), (780, 360), (844, 390)]
"""Sizes of windows, portrait and landscape [px]."""

TOUCH_CONTROLS = (
    "touch-lever-left",
    "touch-pedal-left",
    "touch-pedal-right",
    "touch-lever-right",
    "emergency-stop",
    "take-control",
    "touch-switch",
)

WHAT_COVERS_THE_BUCKET = """() => {
    const { machine, cameras } = window.viewer.stage;
    const { camera } = cameras;
    const point = camera.position.clone().set(1.4, 0, 0);
    point.applyMatrix4(machine.findLink("bucket").matrixWorld).project(camera);
    const x = 0.5 * (1 + point.x) * innerWidth, y = 0.5 * (1 - point.y) * innerHeight;
    return document.elementFromPoint(x, y)?.id ?? "outside of the window";
}"""
"""Id of the element at the cutting lip of the bucket."""

TIMELINE_CONTROLS = (
    "timeline-play",
    "timeline-slider",
    "timeline-slower",
    "timeline-faster",
)


def boxes(page: LivePage, controls: tuple[str, ...]) -> dict[str, tuple[float, ...]]:
    """Return left, top, right and bottom edge of each control [px]."""
    found = {}
    for name in controls:
        box = page.page.get_by_test_id(name).bounding_box()
        assert box is not None, f"{name} is not shown"
        x, y = box["x"], box["y"]
        found[name] = (x, y, x + box["width"], y + box["height"])
    return found


def unreachable(page: LivePage, controls: tuple[str, ...], size: tuple[int, int]) -> list[str]:
    """Return controls that are outside of a window of this size, or overlap another one."""
    page.page.set_viewport_size({"width": size[0], "height": size[1]})
    found = boxes(page, controls)
    bad = [
        name
        for name, (left, top, right, bottom) in found.items()
        if min(left, top) < 0 or right > size[0] or bottom > size[1]
    ]
    for (name, a), (other, b) in combinations(found.items(), 2):
        if a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]:
            bad.append(f"{name} over {other}")
    return bad


def test_on_screen_levers_fit_the_windows_of_phones(site: LiveSite, open_page: OpenPage) -> None:
    page = open_page(f"{site.url}?help=no&quality=low", width=360, height=740, is_phone=True)
    page.wait_until(lambda: page.is_shown, site.spin, LOADED)
    page.page.get_by_test_id("touch-lever-left").wait_for()
    assert {size: bad for size in PHONES if (bad := unreachable(page, TOUCH_CONTROLS, size))} == {}
    for width, height in PHONES:  # the tools are one row
        page.page.set_viewport_size({"width": width, "height": height})
        _, top, _, bottom = boxes(page, ("toolbar",))["toolbar"]
        assert bottom - top < 60, (width, height)
    page.page.get_by_test_id("emergency-stop").click(timeout=1e3 * LOADED)
    release = ("emergency-stop-release",)
    page.page.get_by_test_id(*release).wait_for(timeout=1e3 * LOADED)
    assert {size: bad for size in PHONES if (bad := unreachable(page, release, size))} == {}


def test_levers_on_a_phone_leave_the_bucket_free(site: LiveSite, open_page: OpenPage) -> None:
    url = f"{site.url}?help=no&quality=low&camera=bucket"
    page = open_page(url, width=375, height=667, is_phone=True)
    page.wait_until(lambda: page.is_shown, site.spin, LOADED)

    def is_free() -> bool:
        return bool(page.page.evaluate(WHAT_COVERS_THE_BUCKET) == "scene")

    for width, height in ((375, 667), (667, 375)):
        page.page.set_viewport_size({"width": width, "height": height})
        page.wait_until(is_free, site.spin, LOADED)


def test_menu_leaves_the_emergency_stop_free_and_closes_by_escape(
    site: LiveSite, show_page: Callable[[LiveSite], LivePage]
) -> None:
    page = show_page(site)
    page.page.get_by_test_id("view-menu").click(timeout=1e3 * LOADED)
    panel = page.page.get_by_test_id("view-menu-panel")
    panel.get_by_text("Moisture").click(timeout=1e3 * LOADED)
    heading = page.page.get_by_test_id("legend").get_by_role("heading", name="Moisture %")
    heading.wait_for(timeout=1e3 * LOADED)  # with a space, for screen readers
    stop = page.page.get_by_test_id("emergency-stop")
    assert stop.evaluate(
        """(button) => {
            const { x, y, width, height } = button.getBoundingClientRect();
            return button.contains(document.elementFromPoint(x + width / 4, y + height / 4));
        }"""
    )
    page.page.keyboard.press("Escape")
    panel.wait_for(state="hidden", timeout=1e3 * LOADED)


def test_timeline_and_tools_fit_narrow_windows(
    ros_process: StartProcess, open_page: OpenPage
) -> None:
    server = ros_process(
        [sys.executable, "-m", "earthmoving_sim", "view", str(BAG), "--port", "0", "--no-browser"]
    )
    url = server.wait_for_output(r"http://localhost:\d+/").group()
    page = open_page(f"{url}?help=no&quality=low", width=640, height=400)
    page.page.get_by_test_id("timeline").wait_for(timeout=1e3 * LOADED)
    sizes = [(320, 480), (640, 400), (700, 500), (1001, 500)]
    assert {
        size: bad for size in sizes if (bad := unreachable(page, TIMELINE_CONTROLS, size))
    } == {}
    for width in range(320, 900, 60):  # the tools are one row
        page.page.set_viewport_size({"width": width, "height": 500})
        _, top, _, bottom = boxes(page, ("toolbar",))["toolbar"]
        assert bottom - top < 60, width
