"""The live page in a browser shows what the topics say, also after restarts and on a slow link."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from std_srvs.srv import Trigger
from support.live_page import LOADED, LivePage
from support.live_site import LiveSite
from support.throttled_relay import ThrottledRelay

from msg_bridge.testing.fixtures import StartProcess
from msg_bridge.testing.ros_context import Ros

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

ShowPage = Callable[..., LivePage]

BAG = Path(__file__).parents[2] / "bags/format_2"

SLOW_LINK = 10e3
"""Rate of the slow link [bytes/s]: a few frames a second of the 50 that a fast one carries."""

MAX_LAG = 2.5
"""Largest delay of a page on a slow link [s of simulated time]; a queue would grow to 10 s."""


def test_page_loads_offline_and_shows_the_terrain_of_the_topic(
    site: LiveSite, show_page: ShowPage
) -> None:
    page = show_page(site)
    site.wait_for_terrain(page)
    assert page.foreign_requests == []


def test_camera_keys_switch_the_view(site: LiveSite, show_page: ShowPage) -> None:
    page = show_page(site)
    pictures = []
    for key, camera in (("2", "cab"), ("3", "top"), ("4", "bucket"), ("1", "orbit")):
        page.page.keyboard.press(key)
        page.wait_until(lambda camera=camera: page.state()["camera"] == camera, site.spin)
        page.draw_frames(4, site.spin)  # until the transition has ended
        pictures.append(page.page.locator("#scene").screenshot(timeout=1e3 * LOADED))
    assert len(set(pictures)) == len(pictures)


def test_page_reconnects_to_a_restarted_viewer_and_a_new_run(
    site: LiveSite, show_page: ShowPage
) -> None:
    page = show_page(site)
    site.wait_for_terrain(page)
    run = page.state()["run"]
    site.viewer.stop()
    page.wait_until(lambda: page.state()["connection"] != "online")
    site.start_viewer(site.port)
    page.wait_until(lambda: page.state()["connection"] == "online", site.spin, LOADED)
    site.wait_for_terrain(page)
    site.ros.call(Trigger, "/sim/reset", Trigger.Request())
    page.wait_until(lambda: page.state()["run"] not in (run, None), site.spin, LOADED)
    site.wait_for_terrain(page)


def test_recording_stays_where_it_was_shown_when_its_server_is_restarted(
    ros_process: StartProcess, open_page: Callable[[str], LivePage]
) -> None:
    command = [sys.executable, "-m", "earthmoving_sim", "view", str(BAG), "--no-browser", "--port"]
    server = ros_process([*command, "0"])
    url = server.wait_for_output(r"http://localhost:\d+/").group()
    page = open_page(f"{url}?help=no&quality=low")
    page.wait_until(lambda: page.is_shown, timeout=LOADED)
    time = page.page.get_by_test_id("timeline-time")
    waiting = page.page.get_by_test_id("timeline-waiting")
    page.page.keyboard.press("Space")
    page.page.get_by_label("Play", exact=True).wait_for(timeout=1e3 * LOADED)
    page.page.keyboard.press("End")
    page.wait_until(lambda: not waiting.is_visible())
    shown = time.inner_text()
    server.stop()
    page.wait_until(lambda: page.state()["connection"] != "online")
    page.page.keyboard.press("Home")  # is lost
    ros_process([*command, url.rstrip("/").rpartition(":")[2]])
    page.wait_until(lambda: page.state()["connection"] == "online", timeout=LOADED)
    page.wait_until(lambda: time.inner_text() == shown and not waiting.is_visible())
    page.page.get_by_label("Play", exact=True).wait_for(timeout=1e3 * LOADED)


def test_large_map_arrives_whole(ros: Ros, ros_process: StartProcess, show_page: ShowPage) -> None:
    site = LiveSite(ros, ros_process, soil={"site.num_points": 1025})
    site.wait_for_terrain(show_page(site))


def test_slow_link_drops_frames_instead_of_lagging(
    site: LiveSite, open_page: Callable[[str], LivePage]
) -> None:
    relay = ThrottledRelay(site.port)
    try:
        page = open_page(site.url.replace(str(site.port), str(relay.port)))
        page.wait_until(lambda: page.is_shown, site.spin, LOADED)
        relay.bytes_per_second = SLOW_LINK
        start = site.sim_time()
        lags = []

        def observe() -> None:
            site.spin()
            lags.append(site.sim_time() - page.state()["time"])

        page.wait_until(lambda: site.sim_time() > start + 12.0, observe, LOADED)
        assert max(lags[len(lags) // 2 :]) < MAX_LAG
    finally:
        relay.close()
