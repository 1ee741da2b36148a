"""Pages of other origins, and names that point to this computer, are rejected."""

from __future__ import annotations

import pytest

from msg_bridge.contract.errors import ParameterError
from msg_bridge.contract.loopback import is_loopback
from viewer.address import page_address
from viewer.params import ViewerParams
from viewer.server.access import AccessPolicy, make_token

LOCAL = AccessPolicy("127.0.0.1")


@pytest.mark.parametrize("host", ["localhost:8080", "127.0.0.1:9", "[::1]:8080", "LOCALHOST"])
def test_local_names_are_accepted(host: str) -> None:
    assert LOCAL.check_host(host) is None


@pytest.mark.parametrize(
    "host", ["evil.example:8080", "localhost.evil.example", "", "a b", "localhost:8080/../x", "0"]
)
def test_other_names_for_the_loopback_address_are_rejected(host: str) -> None:
    assert LOCAL.check_host(host)


@pytest.mark.parametrize(
    ("origin", "is_accepted"),
    [
        (None, True),
        ("http://localhost:8080", True),
        ("https://localhost:8080", True),
        ("http://localhost:8081", False),
        ("http://evil.example", False),
        ("null", False),
        ("file://", False),
        ("http://[", False),
        ("http://\udcff", False),
        ("https://site.example:8443", False),
    ],
)
def test_web_socket_needs_a_page_of_this_server(origin: str | None, is_accepted: bool) -> None:
    problem = LOCAL.check_origin(origin, "localhost:8080")
    assert (problem is None) is is_accepted
    assert problem is None or problem.isprintable()


@pytest.mark.parametrize(
    ("allowed", "sent"),
    [
        ("https://site.example:8443", "https://site.example:8443"),
        ("HTTPS://Site.example:443", "https://site.example"),
        ("http://site.example:80", "http://site.example"),
        ("http://site.example:443", "http://site.example:443"),
    ],
)
def test_allowed_origin_may_connect_as_browsers_send_it(allowed: str, sent: str) -> None:
    assert ViewerParams.from_mapping({"allowed_origins": [allowed]})
    policy = AccessPolicy("127.0.0.1", allowed_origins=(allowed,))
    assert policy.check_origin(sent, "localhost:8080") is None
    assert policy.check_host(sent.partition("//")[2]) is None


def test_token_is_compared() -> None:
    token = make_token()
    policy = AccessPolicy("0.0.0.0", token)
    assert len(token) >= 32
    assert policy.is_token_valid(token)
    assert not policy.is_token_valid("")
    assert not policy.is_token_valid(token + "ü")
    assert AccessPolicy("127.0.0.1").is_token_valid(token)
    assert page_address("127.0.0.1", 8080, "a/b") == "http://localhost:8080/#token=a%2Fb"


@pytest.mark.parametrize(
    ("address", "expected"),
    [("127.0.0.1", True), ("::1", True), ("0.0.0.0", False), ("10.0.0.1", False), ("", False)],
)
def test_loopback_addresses_are_known(address: str, expected: bool) -> None:
    assert is_loopback(address) is expected


@pytest.mark.parametrize(
    "values",
    [
        {"token": "short"},
        {"allowed_origins": ["example.org"]},
        {"allowed_origins": ["*"]},
        {"allowed_origins": ["https://*.site.example"]},
        {"allowed_origins": ["https://site.example/"]},
        {"allowed_origins": ["http://["]},
    ],
)
def test_parameters_that_weaken_access_are_rejected(values: dict[str, object]) -> None:
    with pytest.raises(ParameterError):
        ViewerParams.from_mapping(values)
