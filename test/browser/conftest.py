"""The live page in a real browser: Chromium with WebGL in software, driven by playwright."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import pytest
from support.live_page import LOADED, LivePage
from support.live_site import LiveSite

from msg_bridge.testing.fixtures import StartProcess
from msg_bridge.testing.ros_context import Ros

if TYPE_CHECKING:
    from playwright.sync_api import Browser

_NAMES = ("chromium", "chromium-browser", "google-chrome")

_ARGUMENTS = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--mute-audio")
"""WebGL 2 without a GPU."""


def _find_chromium() -> str:
    """Return the path of the browser; skip the test without one, or fail if `CI` is set."""
    names = (os.environ["CHROMIUM"],) if os.environ.get("CHROMIUM") else _NAMES
    for name in names:
        path = shutil.which(name)
        if path:
            return path
    reason = f"none of {', '.join(names)} is installed: run `make chromium`, or set CHROMIUM"
    if os.environ.get("CI"):
        pytest.fail(reason)
    pytest.skip(reason)


@pytest.fixture(scope="session")
def chromium() -> str:
    """Return the path of the browser."""
    return _find_chromium()


@pytest.fixture(scope="session")
def browser(chromium: str) -> Iterator[Browser]:
    """Return a browser for all tests of a process."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=_ARGUMENTS)
        yield browser
        browser.close()


class OpenPage:
    """Opens pages, which are closed at the end of the test."""

    def __init__(self, browser: Browser) -> None:
        self._browser = browser
        self.pages: list[LivePage] = []

    def __call__(
        self, url: str, *, width: int = 640, height: int = 480, is_phone: bool = False
    ) -> LivePage:
        """Open an address in a window of its own, small because WebGL is in software."""
        context = self._browser.new_context(
            viewport={"width": width, "height": height}, is_mobile=is_phone, has_touch=is_phone
        )
        page = LivePage(context, url)
        self.pages.append(page)
        return page


@pytest.fixture
def open_page(browser: Browser) -> Iterator[OpenPage]:
    """Return a function that opens pages; errors of their scripts fail the test."""
    opened = OpenPage(browser)
    yield opened
    for page in opened.pages:
        page.close()
    errors = [error for page in opened.pages for error in page.errors]
    assert not errors, errors


@pytest.fixture
def site(ros: Ros, ros_process: StartProcess) -> LiveSite:
    """Return soil, excavator and viewer as processes."""
    return LiveSite(ros, ros_process)


ShowPage = Callable[..., LivePage]


@pytest.fixture
def show_page(open_page: OpenPage) -> ShowPage:
    """Return a function that opens the page of a site and waits until all is shown."""

    def show(site: LiveSite, *, keep_help: bool = False) -> LivePage:
        page = open_page(site.url)
        page.wait_until(lambda: page.is_shown, site.spin, LOADED)
        if not keep_help:
            page.page.keyboard.press("Escape")
        return page

    return show
