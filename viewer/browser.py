"""Open the page in a browser, where there is a display."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
import threading
import time
import webbrowser

__all__ = ["open_page", "open_page_when_ready"]

_MAX_WAIT = 120.0
"""Wall time for which a server is waited for [s]."""

_POLL_PERIOD = 0.2


def open_page(address: str) -> bool:
    """Open a page in the browser of the user; return whether one was started.

    Without a display nothing is started: a browser in the terminal cannot show the page.
    """
    has_display = sys.platform in ("darwin", "win32") or bool(
        os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    )
    try:
        return has_display and webbrowser.open(address)
    except webbrowser.Error:
        return False


def open_page_when_ready(address: str, port: int) -> None:
    """Open a page once its server on the loopback address listens; return at once."""

    def wait_and_open() -> None:
        deadline = time.monotonic() + _MAX_WAIT
        while time.monotonic() < deadline:
            with (
                contextlib.suppress(OSError),
                socket.create_connection(("127.0.0.1", port), timeout=1.0),
            ):
                open_page(address)
                return
            time.sleep(_POLL_PERIOD)

    threading.Thread(target=wait_and_open, name="open_page", daemon=True).start()
