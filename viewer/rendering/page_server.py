"""PageServer: serves the page to one browser on the loopback address, and draws pictures with it.

It sends what the server of the live page sends (`viewer.server`), but at the times at which a
picture is requested: each picture shows the whole scene as it is then.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import msgpack
from aiohttp import WSMsgType, web

from viewer.rendering.camera import Camera
from viewer.rendering.errors import RenderError
from viewer.rendering.picture import Picture, PictureSize
from viewer.scene.scene import Scene
from viewer.server.access import AccessPolicy, make_token
from viewer.server.encoding import SceneEncoder
from viewer.server.frames import FrameStream
from viewer.server.packing import pack
from viewer.server.page_messages import PROTOCOL
from viewer.server.static_files import PAGE_FOLDER, find_files

__all__ = ["PageServer"]

_ADDRESS = "127.0.0.1"
_STREAM = "/stream"

_MAX_PICTURE_BYTES = 256 * 2**20
_LOGIN_TIME = 180.0
"""Wall time that the browser has from its start to its login [s]."""

_PICTURE_TIME = 300.0
"""Wall time that a picture may take [s]: large ones take long without a GPU."""

_POLL_TIME = 0.25
"""Wall time between checks whether the browser still runs [s]."""

_FRAME_BUDGET = 2**26
"""Size of particles and tiles in a frame [bytes]: all that has changed fits."""


class PageServer:
    """The page for one browser, which logs in with a secret that is valid once.

    All methods are called in the event loop's thread.

    Attributes:
        url: address of the page with the secret; empty before `start`.
    """

    def __init__(self, scene: Scene, *, quality: str, page: Path = PAGE_FOLDER) -> None:
        """
        Args:
            scene: what is shown.
            quality: low, medium or high.
            page: folder of the built page.

        Raises:
            RenderError: the page is not built.
        """
        self.url = ""
        self._encoder = SceneEncoder(scene)
        self._frames = FrameStream(self._encoder, budget=_FRAME_BUDGET)
        self._quality = quality
        self._token: str | None = make_token()
        self._policy = AccessPolicy(_ADDRESS)
        self._files = find_files(page)
        if "/" not in self._files:
            raise RenderError(
                "the page is not built: run `python viewer/page/build_page.py` in the source folder"
            )
        self._socket: web.WebSocketResponse | None = None
        self._logged_in = asyncio.Event()
        self._pictures: dict[int, asyncio.Future[dict[str, Any]]] = {}
        self._failure: str | None = None
        self._num_pictures = 0
        app = web.Application(middlewares=[self._check_host])
        app.router.add_get(_STREAM, self._stream)
        app.router.add_get("/{path:.*}", self._file)
        self._runner = web.AppRunner(app, access_log=None)

    async def start(self) -> None:
        """Listen on a free port."""
        await self._runner.setup()
        site = web.TCPSite(self._runner, _ADDRESS, 0)
        await site.start()
        port = self._runner.addresses[0][1]
        self.url = (
            f"http://{_ADDRESS}:{port}/?renderer=1&quality={self._quality}#token={self._token}"
        )

    async def close(self) -> None:
        """Close the connection, and stop to listen."""
        if self._socket is not None:
            await self._socket.close()
        await self._runner.cleanup()

    async def draw(
        self, camera: Camera, size: PictureSize, form: str, check: Callable[[], None]
    ) -> Picture:
        """Return a picture of the scene as it is now.

        Args:
            camera: from where.
            size: of the picture.
            form: encoding, one of `FORMATS`.
            check: called while waiting; raises RenderError if the browser has ended.

        Raises:
            RenderError: the browser has ended or reports an error, or it takes too long.
        """
        await self._wait(self._logged_in.wait(), _LOGIN_TIME, check, "the page has not started")
        socket = self._socket
        assert socket is not None
        self._check(check)  # the browser may have ended since the last picture
        time = self._encoder.scene.time
        for message in self._frames.next_messages():
            await self._send(socket, message, check)
        self._frames.acknowledge(self._frames.seq)
        self._num_pictures += 1
        number = self._num_pictures
        request = {
            "type": "render",
            "id": number,
            "time": time,
            "camera": camera.to_message(),
            "width": size.width,
            "height": size.height,
            "format": form,
        }
        future = asyncio.get_running_loop().create_future()
        self._pictures[number] = future
        try:
            await self._send(socket, pack(request), check)
            answer = await self._wait(future, _PICTURE_TIME, check, "the page draws no picture")
        finally:
            del self._pictures[number]
        return Picture.from_message(answer, size, form, time)

    async def _send(
        self, socket: web.WebSocketResponse, message: bytes, check: Callable[[], None]
    ) -> None:
        """Send a message to the page, and fail if the browser has ended."""
        try:
            await socket.send_bytes(message)
        except ConnectionError as error:
            self._check(check)
            raise RenderError(f"the page cannot be reached: {error}") from error

    def _check(self, check: Callable[[], None]) -> None:
        """Fail if the browser has ended or reported an error."""
        check()
        if self._failure is not None:
            raise RenderError(self._failure)

    async def _wait(
        self, waited: Awaitable[Any], limit: float, check: Callable[[], None], problem: str
    ) -> Any:
        """Wait for something, and fail if the browser ends or reports an error meanwhile."""
        task = asyncio.ensure_future(waited)
        deadline = asyncio.get_running_loop().time() + limit
        try:
            while True:
                done, _ = await asyncio.wait([task], timeout=_POLL_TIME)
                if done:
                    return task.result()
                self._check(check)
                if asyncio.get_running_loop().time() > deadline:
                    raise RenderError(f"{problem} within {limit:g} s")
        finally:
            task.cancel()

    @web.middleware
    async def _check_host(
        self, request: web.Request, handler: Callable[[web.Request], Awaitable[web.StreamResponse]]
    ) -> web.StreamResponse:
        host = request.headers.get("Host", "")
        problem = self._policy.check_host(host)
        if problem is not None:
            raise web.HTTPForbidden(text=problem)
        return await handler(request)

    async def _file(self, request: web.Request) -> web.StreamResponse:
        found = self._files.get(request.path)
        if found is None:
            raise web.HTTPNotFound
        headers = self._policy.headers(request.headers.get("Host", ""))
        return web.FileResponse(found.path, headers={**headers, "Content-Type": found.content_type})

    async def _stream(self, request: web.Request) -> web.StreamResponse:
        host, origin = request.headers.get("Host", ""), request.headers.get("Origin")
        problem = self._policy.check_origin(origin, host)
        if problem is not None or origin is None:
            raise web.HTTPForbidden(text=problem or "only the page may connect")
        socket = web.WebSocketResponse(max_msg_size=_MAX_PICTURE_BYTES, compress=False)
        await socket.prepare(request)
        if await self._log_in(socket):
            await self._receive(socket)
        return socket

    async def _log_in(self, socket: web.WebSocketResponse) -> bool:
        """Process the login; return whether it was the first one with the secret."""
        try:
            login = json.loads(await socket.receive_str())
            is_valid = self._token is not None and login.get("token") == self._token
        except (TypeError, ValueError, AttributeError):
            is_valid = False
        if not is_valid:
            await socket.send_bytes(self._encoder.error("token", "the secret is not valid"))
            await socket.close()
            return False
        self._token = None
        await socket.send_bytes(pack(_HELLO))
        self._socket = socket
        self._logged_in.set()
        return True

    async def _receive(self, socket: web.WebSocketResponse) -> None:
        """Process messages of the page until it closes the connection."""
        async for message in socket:
            if message.type is WSMsgType.BINARY:
                picture = msgpack.unpackb(message.data, raw=False)
                future = self._pictures.get(picture.get("id"))
                if future is not None and not future.done():
                    future.set_result(picture)
            elif message.type is WSMsgType.TEXT:
                found = json.loads(message.data)
                if found.get("type") == "failure":
                    self._failure = f"the page reports: {found.get('message')}"
        self._failure = self._failure or "the page has closed its connection"


_HELLO = {
    "type": "hello",
    "protocol": PROTOCOL,
    "server": "earthmoving_sim",
    "source": "bag",
    "title": "",
    "may_drive": False,
    "may_control_simulation": False,
    "may_record": False,
    "keys": {},
    "action_keys": {},
    "controls": [],
    "frame_rate": 0.0,
}
