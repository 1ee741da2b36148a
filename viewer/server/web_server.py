"""WebServer: the aiohttp application of a hub, in a thread of its own."""

from __future__ import annotations

import asyncio
import contextlib
import os
import threading
from collections.abc import Awaitable, Callable
from pathlib import Path

from aiohttp import WSCloseCode, web

from msg_bridge.contract.errors import EarthmovingError
from viewer.server.client import Client
from viewer.server.hub import Hub
from viewer.server.page_messages import MAX_MESSAGE_SIZE, RequestRejectedError
from viewer.server.static_files import MISSING_PAGE, PAGE_FOLDER, find_files

__all__ = ["ServerError", "WebServer"]

_HEARTBEAT = 20.0
"""Wall time after which a silent connection is tested [s]."""

_START_TIME = 10.0
_STOP_TIME = 5.0

_Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class ServerError(EarthmovingError):
    """The server cannot be started."""


class WebServer:
    """A web server in a thread.

    Attributes:
        port: port that it listens on.
    """

    def __init__(self, hub: Hub, address: str, port: int, page: Path = PAGE_FOLDER) -> None:
        """Start the server.

        Args:
            hub: what it serves.
            address: address to listen on.
            port: port to listen on; 0: any that is free.
            page: folder of the built page.

        Raises:
            ServerError: it cannot listen there.
        """
        self.port = port
        self._hub, self._address = hub, address
        self._files = find_files(page)
        self._sockets: set[web.WebSocketResponse] = set()
        self._loop = asyncio.new_event_loop()
        self._stopped = asyncio.Event()
        self._failure: Exception | None = None
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, name="web_server", daemon=True)
        self._thread.start()
        is_ready = self._ready.wait(_START_TIME)
        if self._failure is not None:
            raise ServerError(
                f"the viewer cannot listen on {address}:{port}: {_reason(self._failure)}; choose"
                " another port (`--port`, or `-p port:=` of the node)"
            ) from self._failure
        if not is_ready:
            self.stop()
            raise ServerError(f"the server of the page has not started within {_START_TIME:g} s")

    def stop(self) -> None:
        """Release all levers, close all connections and end the thread."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stopped.set)
            self._thread.join(_STOP_TIME)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        finally:
            self._loop.close()

    async def _serve(self) -> None:
        app = web.Application(middlewares=[self._check_host], client_max_size=MAX_MESSAGE_SIZE)
        app.on_response_prepare.append(self._add_headers)
        app.router.add_get("/stream", self._stream)
        app.router.add_get("/{path:.*}", self._file)
        runner = web.AppRunner(app, access_log=None, shutdown_timeout=1.0)
        try:
            await runner.setup()
            await web.TCPSite(runner, self._address, self.port).start()
        except Exception as error:  # OSError, OverflowError, and others of the address
            self._failure = error
            await runner.cleanup()
            self._ready.set()
            return
        self.port = int(runner.addresses[0][1])
        self._ready.set()
        levers = asyncio.create_task(self._hub.run())
        await self._stopped.wait()
        levers.cancel()
        self._hub.close()
        for socket in list(self._sockets):
            with contextlib.suppress(ConnectionError, asyncio.TimeoutError):
                await asyncio.wait_for(socket.close(code=WSCloseCode.GOING_AWAY), 1.0)
        await runner.cleanup()

    @web.middleware
    async def _check_host(self, request: web.Request, handler: _Handler) -> web.StreamResponse:
        """Reject requests for another host."""
        problem = self._hub.access.check_host(request.headers.get("Host", ""))
        if problem is not None:
            self._hub.count_rejection("host", problem)
            return web.Response(status=403, text=problem)
        return await handler(request)

    async def _add_headers(self, request: web.Request, response: web.StreamResponse) -> None:
        response.headers.update(self._hub.access.headers(request.headers.get("Host", "")))
        response.headers.popall("Server", None)

    async def _file(self, request: web.Request) -> web.StreamResponse:
        """Return a file of the page."""
        file = self._files.get(request.path)
        if file is None:
            if request.path == "/":
                return web.Response(status=503, text=MISSING_PAGE, content_type="text/html")
            raise web.HTTPNotFound
        return web.FileResponse(file.path, headers={"Content-Type": file.content_type})

    async def _stream(self, request: web.Request) -> web.StreamResponse:
        """Serve one client."""
        host = request.headers.get("Host", "")
        problem = self._hub.access.check_origin(request.headers.get("Origin"), host)
        if problem is not None:
            self._hub.count_rejection("origin", problem)
            return web.Response(status=403, text=problem)
        socket = web.WebSocketResponse(
            max_msg_size=MAX_MESSAGE_SIZE, heartbeat=_HEARTBEAT, compress=False
        )
        client = Client(self._hub, socket, self._hub.new_number())
        try:
            self._hub.add_login(client)
        except RequestRejectedError as error:
            self._hub.count_rejection(error.code, str(error))
            return web.Response(status=503, text=str(error))
        try:
            await socket.prepare(request)
            self._sockets.add(socket)
            await client.run()
        except ConnectionError:  # the client has gone while something was sent to it
            pass
        finally:
            self._sockets.discard(socket)
            self._hub.discard(client)
        return socket


def _reason(error: Exception) -> str:
    """Return why a server cannot listen; asyncio's own text repeats the address."""
    if isinstance(error, OSError) and error.errno is not None and error.errno > 0:
        return os.strerror(error.errno)
    return str(error)
