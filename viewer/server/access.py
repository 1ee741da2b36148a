"""Rules of access: Host and Origin of a request, the token, and the headers of all responses.

A page of another origin that the user has open could connect to a server on the loopback address,
also under a name that its owner points to 127.0.0.1 (DNS rebinding). So on the loopback address
only local names are accepted as Host, and a WebSocket only from a page of the same host and port,
or of an origin that is allowed by a parameter. Programs send no Origin and are not rejected.
"""

from __future__ import annotations

import hmac
import re
import secrets
from collections.abc import Collection
from dataclasses import dataclass
from urllib.parse import SplitResult, urlsplit

from msg_bridge.contract.loopback import is_loopback
from msg_bridge.contract.printable import printable

__all__ = ["AccessPolicy", "invalid_origins", "make_token"]

_HOST = re.compile(r"[A-Za-z0-9._-]+(:[0-9]{1,5})?|\[[0-9A-Fa-f:.]+\](:[0-9]{1,5})?")
_LOCAL_NAMES = ("localhost", "127.0.0.1", "::1")


def make_token() -> str:
    """Return a token that cannot be guessed, of 32 characters."""
    return secrets.token_urlsafe(24)


@dataclass(frozen=True)
class AccessPolicy:
    """Rules of access.

    Attributes:
        address: address that the server listens on.
        token: token that clients must give; empty for none.
        allowed_origins: origins beside the server's own, as `https://host:port`.
    """

    address: str
    token: str = ""
    allowed_origins: tuple[str, ...] = ()

    def check_host(self, host: str) -> str | None:
        """Return why a Host header is rejected; None if it is accepted."""
        if not _HOST.fullmatch(host):
            return "the Host header is no host name"
        if not is_loopback(self.address):
            return None
        name = _host_name(host)
        allowed = {*_LOCAL_NAMES, self.address, *map(_origin_host, self.allowed_origins)}
        if name in allowed:
            return None
        return f"the host {name} is not this computer; open http://localhost, or allow its origin"

    def check_origin(self, origin: str | None, host: str) -> str | None:
        """Return why a WebSocket is rejected; None if it is accepted.

        Args:
            origin: the header Origin; None without one: no browser.
            host: the header Host.
        """
        if origin is None or origin in map(_as_browsers_send, self.allowed_origins):
            return None
        parts = _split(origin)
        if parts.scheme in ("http", "https") and parts.netloc.lower() == host.lower():
            return None
        return f"pages of {printable(origin[:100])} may not connect; add it to allowed_origins"

    def is_token_valid(self, token: str) -> bool:
        """Return whether a token is the right one, in a time that does not depend on it.

        Without a token of the policy any one is valid: a tab keeps that of an earlier server.
        """
        return not self.token or hmac.compare_digest(token.encode(), self.token.encode())

    def headers(self, host: str) -> dict[str, str]:
        """Return the security headers of a response.

        Args:
            host: the Host header of the request.
        """
        sockets = f" ws://{host} wss://{host}" if _HOST.fullmatch(host) else ""
        policy = (
            "default-src 'none'; script-src 'self'; style-src 'self'; font-src 'self';"
            f" img-src 'self' data: blob:; connect-src 'self' blob: data:{sockets};"
            " worker-src 'self' blob:; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
        )
        return {
            "Content-Security-Policy": policy,
            "X-Content-Type-Options": "nosniff",
            "X-Frame-Options": "DENY",
            "Referrer-Policy": "no-referrer",
            "Cross-Origin-Opener-Policy": "same-origin",
            "Cross-Origin-Resource-Policy": "same-origin",
            "Cache-Control": "no-cache",
        }


def _host_name(host: str) -> str:
    """Return the name in a Host header, without port and brackets, in lower case."""
    name = host[1:].partition("]")[0] if host.startswith("[") else host.partition(":")[0]
    return name.lower().rstrip(".")


def _origin_host(origin: str) -> str:
    return (_split(origin).hostname or "").lower()


def _split(origin: str) -> SplitResult:
    """Return the parts of an origin, all empty if it is no address."""
    try:
        return urlsplit(origin)
    except ValueError:
        return urlsplit("")


def invalid_origins(origins: Collection[str]) -> list[str]:
    """Return those of some origins that are not `http://host[:port]` or `https://host[:port]`."""
    return [
        each
        for each in origins
        if _split(each).scheme not in ("http", "https")
        or not _HOST.fullmatch(_split(each).netloc)
        or each.lower() != f"{_split(each).scheme}://{_split(each).netloc}".lower()
    ]


def _as_browsers_send(origin: str) -> str:
    """Return an origin in lower case and without the default port of its scheme."""
    origin = origin.lower()
    return origin.removesuffix(":443" if origin.startswith("https:") else ":80")
