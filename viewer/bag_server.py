"""Serve one bag on the page, without a node."""

from __future__ import annotations

import threading
from pathlib import Path

from viewer.address import page_address
from viewer.browser import open_page
from viewer.server.access import AccessPolicy
from viewer.server.hub import Hub
from viewer.server.web_server import WebServer
from viewer.sources.bag_folder import BagFolder
from viewer.sources.bag_scene import BagScene

__all__ = ["serve_bag", "start_bag_server"]

_ADDRESS = "127.0.0.1"
_FRAME_RATE = 30.0
_MAX_CLIENTS = 8
_POLL_PERIOD = 0.5


def start_bag_server(bag: Path, port: int) -> WebServer:
    """Start a server on the loopback address that shows one bag; stop it at the end.

    Args:
        bag: the bag.
        port: port to listen on; 0: any that is free.

    Raises:
        EarthmovingError: there is no such bag, it cannot be read, or the port is taken.
    """
    bag = bag.resolve()
    BagScene(bag).close()  # raises now, and not when the page is opened
    hub = Hub(
        AccessPolicy(_ADDRESS),
        server_name="earthmoving_sim view",
        frame_rate=_FRAME_RATE,
        max_clients=_MAX_CLIENTS,
        library=BagFolder(bag.parent, _MAX_CLIENTS, only=bag.name),
        default_bag=bag.name,
    )
    return WebServer(hub, _ADDRESS, port)


def serve_bag(bag: Path, port: int, *, open_browser: bool) -> None:
    """Show one bag until the process is interrupted.

    Args:
        bag, port: as of `start_bag_server`.
        open_browser: whether to open the page in a browser, if there is a display.

    Raises:
        EarthmovingError: as `start_bag_server`.
    """
    server = start_bag_server(bag, port)
    address = page_address(_ADDRESS, server.port)
    print(f"{bag}: open {address} (Ctrl-C ends)", flush=True)
    if open_browser:
        open_page(address)
    interrupted = threading.Event()
    try:
        while not interrupted.wait(_POLL_PERIOD):
            pass
    except KeyboardInterrupt:
        print(flush=True)
    finally:
        server.stop()
