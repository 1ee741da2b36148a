"""Address of the page, as users open it."""

from __future__ import annotations

import contextlib
import ipaddress
import socket
from urllib.parse import quote

from msg_bridge.contract.loopback import is_loopback

__all__ = ["free_port", "page_address"]


def page_address(address: str, port: int, token: str = "") -> str:
    """Return the URL of the page.

    The token follows `#`, so that a browser sends it to no server but in the login.

    Args:
        address: address that the server listens on.
        port: its port.
        token: its token; empty for none.
    """
    host = address
    if is_loopback(address):
        host = "localhost" if address in ("127.0.0.1", "localhost") else address
    elif _is_unspecified(address):
        host = socket.gethostname()
    host = f"[{host}]" if ":" in host else host
    return f"http://{host}:{port}/" + (f"#token={quote(token, safe='')}" if token else "")


def free_port(preferred: int) -> int:
    """Return a port of the loopback address on which nothing listens, if possible a certain one."""
    for port in (preferred, 0):
        with socket.socket() as found:
            found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            with contextlib.suppress(OSError):
                found.bind(("127.0.0.1", port))
                return int(found.getsockname()[1])
    return preferred


def _is_unspecified(address: str) -> bool:
    try:
        return ipaddress.ip_address(address).is_unspecified
    except ValueError:
        return False
