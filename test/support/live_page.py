"""LivePage: one open page, and what a test asks of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from msg_bridge.testing.ros_context import DEADLINE

if TYPE_CHECKING:
    from playwright.sync_api import BrowserContext

__all__ = ["LOADED", "LivePage"]

LOADED = 90.0
"""Timeout of what is drawn in software [s]."""

_MACHINE = "/excavator"
_POLL_MS = 20.0


class LivePage:
    """One page.

    Attributes:
        page: playwright's page.
        errors: uncaught errors of the page's scripts.
        foreign_requests: addresses requested from anywhere but the server of the page.
    """

    def __init__(self, context: BrowserContext, url: str) -> None:
        self._context = context
        self.page = context.new_page()
        self.errors: list[str] = []
        self.foreign_requests: list[str] = []
        origin = "/".join(url.split("/")[:3])
        allowed = (origin, origin.replace("http", "ws", 1), "data:", "blob:")

        def check_request(request: Any) -> None:
            if not request.url.startswith(allowed):
                self.foreign_requests.append(request.url)

        self.page.on("request", check_request)
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(url, wait_until="commit")

    def close(self) -> None:
        """Close the window."""
        self._context.close()

    def crash(self) -> None:
        """End the process of the page, without any message to the server."""
        from playwright.sync_api import Error

        with suppress(Error):  # "Page crashed"
            self.page.goto("chrome://crash")

    def state(self) -> dict[str, Any]:
        """Return `window.viewer.state()`; empty before the page has started."""
        state: dict[str, Any] = self.page.evaluate(
            "() => window.viewer ? window.viewer.state() : {}"
        )
        return state

    def heights(self, row: int, col: int, rows: int, cols: int) -> NDArray[np.float32]:
        """Return heights read back from the page's texture [m], shape (rows, cols)."""
        values = self.page.evaluate(
            "([row, col, rows, cols]) => Array.from(window.viewer.heights(row, col, rows, cols))",
            [row, col, rows, cols],
        )
        return np.asarray(values, dtype=np.float32).reshape(rows, cols)

    @property
    def is_shown(self) -> bool:
        """Whether the page has the whole terrain and a machine."""
        state = self.state()
        return bool(state.get("ready") and state.get("machines"))

    @property
    def has_driver(self) -> bool:
        """Whether any page drives the machine."""
        return _MACHINE in self.state()["drivers"]

    @property
    def is_driving(self) -> bool:
        """Whether this page drives the machine."""
        driver = self.state()["drivers"].get(_MACHINE)
        return driver is not None and bool(driver["is_you"])

    def take_control(self, button: str = "take-control") -> None:
        """Press a button that takes control, and wait until the page drives."""
        self.page.get_by_test_id(button).click(timeout=1e3 * LOADED)
        self.wait_until(lambda: self.is_driving, timeout=LOADED)

    @contextmanager
    def held(self, *keys: str) -> Iterator[None]:
        """Hold keys while the block runs."""
        for key in keys:
            self.page.keyboard.down(key)
        yield
        for key in keys:
            self.page.keyboard.up(key)

    def draw_frames(
        self, count: int, meanwhile: Callable[[], None] = lambda: None, timeout: float = 60.0
    ) -> None:
        """Wait until the page has drawn a number of frames."""
        last = self.state()["frames"] + count
        self.wait_until(lambda: self.state()["frames"] >= last, meanwhile, timeout)

    def wait_until(
        self,
        condition: Callable[[], bool],
        meanwhile: Callable[[], None] = lambda: None,
        timeout: float = DEADLINE,
    ) -> None:
        """Wait for a condition.

        Args:
            condition: ends the wait when it is true.
            meanwhile: called between two looks, for example to spin a node.
            timeout: maximum wall time [s].

        Raises:
            AssertionError: it was not true in time.
        """
        deadline = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < deadline, f"not true within {timeout:g} s: {self._summary()}"
            meanwhile()
            self.page.wait_for_timeout(_POLL_MS)

    def _summary(self) -> dict[str, Any]:
        """Return the state with the names of the machines only."""
        state = self.state()
        return {**state, "machines": list(state.get("machines", ()))}
