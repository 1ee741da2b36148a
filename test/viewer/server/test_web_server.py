"""The server over a real connection: access, limits, and clients that read slowly."""

from __future__ import annotations

import contextlib
import http.client
import json
import socket
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.stream_client import StreamClient
from support.surface_scenes import ChangingTerrain
from support.waiting import until

from msg_bridge.contract.grid import Grid
from viewer.scene.machine_model import MachineModel
from viewer.scene.scene import Scene
from viewer.server.access import AccessPolicy
from viewer.server.backend import Permissions, Recording, Reply, Source
from viewer.server.encoding import SceneEncoder
from viewer.server.hub import MAX_LOGINS, Hub
from viewer.server.web_server import ServerError, WebServer

_PERMISSIONS = Permissions(driving=True, simulation_control=True)


class FakeBackend:
    """Keeps the requests of clients."""

    def __init__(self) -> None:
        self.levers: list[tuple[str, dict[str, float]]] = []
        self.stops: list[tuple[str, bool]] = []
        self.actions: list[str] = []
        self.failures = 0  # number of calls that fail from now

    def publish_levers(self, machine: str, deflections: Mapping[str, float]) -> None:
        if self.failures:
            self.failures -= 1
            raise RuntimeError("not published")
        self.levers.append((machine, dict(deflections)))

    def set_emergency_stop(self, machine: str, pressed: bool) -> None:
        self.stops.append((machine, pressed))

    def control_simulation(self, action: str, reply: Reply) -> None:
        self.actions.append(action)
        reply("the service does not answer")

    def record(self, on: bool, reply: Reply) -> None:
        raise AssertionError("recording is not allowed")

    def recording(self) -> Recording:
        return Recording(False, "", 0)


class Site:
    """A server with a scene of one machine."""

    def __init__(self, page: Path, permissions: Permissions = _PERMISSIONS, **policy: Any) -> None:
        self.terrain = ChangingTerrain(grid=Grid(129, 129, 0.2))
        self.scene, self.backend = Scene(), FakeBackend()
        self.scene.start_run(self.terrain.run_id)
        self.scene.terrain.receive_map(self.terrain.map())
        self.scene.machine("/m").model = MachineModel("m", {}, ())
        self.hub = Hub(
            AccessPolicy(**{"address": "127.0.0.1", **policy}),
            server_name="test",
            frame_rate=100.0,
            max_clients=3,
            permissions=permissions,
            live=Source(SceneEncoder(self.scene), "test"),
            backend=self.backend,
        )
        self.server = WebServer(self.hub, "127.0.0.1", 0, page)

    def client(self, **kwargs: Any) -> StreamClient:
        return StreamClient(self.server.port, **kwargs)

    def get(self, path: str, **headers: str) -> tuple[int, dict[str, str], str]:
        connection = http.client.HTTPConnection("127.0.0.1", self.server.port, timeout=10)
        connection.putrequest("GET", path, skip_host="Host" in headers)
        for name, value in headers.items():
            connection.putheader(name, value)
        connection.endheaders()
        response = connection.getresponse()
        found = (response.status, dict(response.getheaders()), response.read().decode())
        connection.close()
        return found

    def change(self, num_cells: int = 50) -> None:
        with self.scene.lock:
            for chunk in self.terrain.tick(num_cells):
                self.scene.terrain.receive_updates(chunk)
            self.scene.terrain_changed()


@pytest.fixture
def page(tmp_path: Path) -> Path:
    folder = tmp_path / "dist"
    folder.mkdir()
    (folder / "index.html").write_text("<title>page</title>")
    (tmp_path / "secret.txt").write_text("secret")
    return folder


@pytest.fixture
def site(page: Path) -> Iterator[Site]:
    made = Site(page)
    yield made
    made.server.stop()


def test_page_is_served_with_security_headers(site: Site) -> None:
    status, headers, text = site.get("/")
    assert (status, text) == (200, "<title>page</title>")
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["X-Frame-Options"] == "DENY"


@pytest.mark.parametrize(
    "path", ["/../secret.txt", "/%2e%2e/secret.txt", "//etc/passwd", "/x", "/..%2fsecret.txt"]
)
def test_no_other_file_is_served(site: Site, path: str) -> None:
    status, headers, text = site.get(path)
    assert status in (400, 403, 404)
    assert "secret" not in text
    assert "X-Content-Type-Options" in headers


def test_page_that_is_not_built_is_explained(tmp_path: Path) -> None:
    site = Site(tmp_path / "nothing")
    status, _, text = site.get("/")
    site.server.stop()
    assert status == 503
    assert "build_page.py" in text


def test_request_for_another_host_is_rejected(site: Site) -> None:
    status, _, _ = site.get("/", Host="evil.example")
    assert status == 403
    assert site.hub.statistics.rejections()[0] == {"host": 1}


def test_web_socket_of_another_origin_is_rejected(site: Site) -> None:
    with site.client(headers={"Origin": "http://evil.example"}) as client:
        until(lambda: client.is_closed)
    assert client.status == 403
    own = {"Origin": f"http://127.0.0.1:{site.server.port}"}
    with site.client(headers=own) as client:
        until(lambda: client.frames)


def test_token_is_required(page: Path) -> None:
    site = Site(page, token="a-long-token")
    for token, code in (("wrong-token", "wrong_token"), ("", "token_required")):
        with site.client(token=token) as client:
            until(lambda: client.is_closed)
        assert client.errors == [code]
        assert not client.frames
    with site.client(token="a-long-token") as client:
        until(lambda: client.frames)
    site.server.stop()


@pytest.mark.parametrize(
    ("login", "code"),
    [
        ({"type": "ping", "id": 1}, "login_required"),
        ({"type": "login", "token": "", "protocol": 99, "source": "live"}, "wrong_protocol"),
        ({"type": "login", "token": "", "protocol": 1, "source": {"bag": "../x"}}, "no_bags"),
    ],
)
def test_first_message_must_be_a_valid_login(site: Site, login: dict[str, Any], code: str) -> None:
    with site.client(login=login) as client:
        until(lambda: client.is_closed)
    assert client.errors == [code]


def test_rejected_messages_are_answered_and_counted_and_change_nothing(site: Site) -> None:
    with site.client() as client:
        until(lambda: client.frames)
        client.send(type="eval", code="1")
        client.send(type="record", on=True)
        client.send(type="take_control", machine="/other")
        client.send(type="drive", machine="/m", held=["w"], deflections={})
        client.send(type="playback", action="play")
        client.send(type="simulation", action="pause")
        until(lambda: len(client.errors) == 6)
    expected = ["unknown_type", "not_allowed", "no_machine", "not_driving", "live", "simulation"]
    assert client.errors == expected
    assert site.hub.statistics.rejections()[0] == dict.fromkeys(expected, 1)
    assert site.backend.actions == ["pause"]
    assert not site.backend.levers


def test_flood_of_messages_is_limited_but_not_the_emergency_stop(site: Site) -> None:
    with site.client() as client:
        until(lambda: client.frames)
        client.acknowledges = False
        for _ in range(1500):
            client.send_text(json.dumps({"type": "ping", "id": 1}))
        until(lambda: site.hub.statistics.rejections()[0].get("too_many", 0) > 300)
        assert len(client.errors) < 200  # errors are limited too
        client.send(type="emergency_stop", machine="/m", pressed=True)
        until(lambda: site.backend.stops)


def test_client_with_too_many_rejections_is_disconnected(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("viewer.server.client._MAX_REJECTED", 3)
    with site.client() as client:
        until(lambda: client.frames)
        for _ in range(4):
            client.send(type="eval")
        until(lambda: client.is_closed)


def test_failure_while_sending_ends_the_connection_and_is_counted(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any) -> None:
        raise ValueError("one\ntwo")

    with site.client() as client:
        until(lambda: client.frames)
        monkeypatch.setattr(SceneEncoder, "common", fail)
        site.change()
        until(lambda: client.is_closed)
    counts, last = site.hub.statistics.rejections()
    assert counts == {"frames": 1}
    assert last == "frames: ValueError: one\\ntwo"  # fit for the diagnostics


def test_silent_driver_is_released_after_a_failure_of_the_levers(site: Site) -> None:
    with site.client() as driver:
        until(lambda: driver.frames)
        driver.send(type="take_control", machine="/m")
        until(lambda: site.hub.driving.drivers)
        driver.send(type="drive", machine="/m", held=["i"], deflections={})
        until(lambda: site.backend.levers)
        site.backend.failures = 1
        until(lambda: site.hub.statistics.rejections()[0].get("levers"))
        until(lambda: site.backend.levers and not any(site.backend.levers[-1][1].values()))


def test_message_that_is_too_large_ends_the_connection(site: Site) -> None:
    with site.client() as client:
        until(lambda: client.frames)
        client.send_text("x" * 100_000)
        until(lambda: client.is_closed)


def test_number_of_clients_is_limited(site: Site) -> None:
    clients = [site.client().__enter__() for _ in range(3)]
    until(lambda: all(client.frames for client in clients))
    with site.client() as extra:
        until(lambda: extra.is_closed)
    assert extra.status == 503
    clients[0].close()
    until(lambda: not site.hub.is_full)
    with site.client() as extra:
        until(lambda: extra.frames)
    for client in clients:
        client.close()


def test_connections_without_login_take_no_place_of_a_client(site: Site) -> None:
    address = ("127.0.0.1", site.server.port)
    upgrade = (
        b"GET /stream HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\n"
        b"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        b"Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n"
    )
    with contextlib.ExitStack() as stack:

        def connect() -> bytes:
            """Connect without a login; return the HTTP status."""
            connection = stack.enter_context(socket.create_connection(address, 10.0))
            connection.sendall(upgrade)
            return connection.recv(4096).split()[1]

        statuses = [connect() for _ in range(MAX_LOGINS - 1)]
        client = stack.enter_context(site.client())
        until(lambda: client.frames)
        statuses += [connect(), connect()]
    assert statuses == [*[b"101"] * MAX_LOGINS, b"503"]


def test_everyone_may_stop_a_machine_where_driving_is_not_allowed(page: Path) -> None:
    site = Site(page, Permissions())
    with site.client() as client:
        until(lambda: client.frames)
        client.send(type="emergency_stop", machine="/m", pressed=True)
        client.send(type="emergency_stop", machine="/m", pressed=False)
        client.send(type="take_control", machine="/m")
        until(lambda: len(client.errors) == 2)
    site.server.stop()
    assert client.errors == ["not_allowed"] * 2
    assert site.backend.stops == [("/m", True)]


def test_driver_is_shown_to_all_and_levers_are_zero_after_the_connection(site: Site) -> None:
    with site.client() as watcher:
        with site.client() as driver:
            until(lambda: driver.frames and watcher.frames)
            driver.send(type="take_control", machine="/m")
            until(lambda: driver.last("control")["drivers"].get("/m", {}).get("is_you"))
            until(lambda: "/m" in watcher.last("control")["drivers"])
            assert not watcher.last("control")["drivers"]["/m"]["is_you"]
            watcher.send(type="take_control", machine="/m")
            until(lambda: watcher.errors == ["machine_taken"])
            driver.send(type="drive", machine="/m", held=["i"], deflections={})
            until(lambda: any(values["right_y"] > 0 for _, values in site.backend.levers))
            watcher.send(type="emergency_stop", machine="/m", pressed=True)
            until(lambda: site.backend.stops == [("/m", True)])
            watcher.send(type="emergency_stop", machine="/m", pressed=False)
            until(lambda: "not_driving" in watcher.errors)
        until(lambda: watcher.last("control")["drivers"] == {})
        assert set(site.backend.levers[-1][1].values()) == {0.0}


def test_client_that_stops_reading_delays_no_other_and_catches_up(site: Site) -> None:
    with site.client() as slow, site.client() as fast:
        until(lambda: slow.num_tiles == 81 and fast.num_tiles == 81)
        slow.acknowledges = False
        enough = len(fast.frames) + 50

        def change_until_enough() -> bool:
            site.change()
            return len(fast.frames) >= enough

        until(change_until_enough)
        stalled = len(slow.frames)
        until(lambda: np.array_equal(fast.heights(), site.terrain.height))
        assert len(slow.frames) <= stalled + 2
        slow.acknowledges = True
        slow.send(type="ack", seq=slow.last("frame")["seq"])
        until(lambda: np.array_equal(slow.heights(), site.terrain.height))


def test_start_that_fails_is_reported_once_with_the_options(site: Site) -> None:
    port = site.server.port
    with pytest.raises(ServerError, match="`--port`, or `-p port:=`") as failure:
        WebServer(site.hub, "127.0.0.1", port)
    assert str(failure.value).count(str(port)) == 1
    with pytest.raises(ServerError, match="0-65535"):
        WebServer(site.hub, "127.0.0.1", 70000)
