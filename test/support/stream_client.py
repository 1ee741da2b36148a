"""A client of the viewer's stream, in a thread."""

from __future__ import annotations

import asyncio
import threading
from collections import defaultdict
from collections.abc import Mapping
from typing import Any

import aiohttp
import msgpack
import numpy as np
from numpy.typing import NDArray

from viewer.scene.terrain_tiles import TILE

__all__ = ["StreamClient"]


class StreamClient:
    """Logs in, acknowledges frames and keeps what was received.

    Attributes:
        messages: received messages by type.
        tiles: newest content of each tile, dtype `TILE`, by its number.
        status: HTTP status if the connection was rejected, else 101.
        is_closed: whether the server has closed the connection.
        acknowledges: whether frames are acknowledged.
    """

    def __init__(
        self,
        port: int,
        *,
        token: str = "",
        bag: str | None = None,
        headers: Mapping[str, str] | None = None,
        login: Mapping[str, Any] | None = None,
    ) -> None:
        self.messages: dict[str, list[dict[str, Any]]] = defaultdict(list)
        self.tiles: dict[int, NDArray[np.void]] = {}
        self.status = 0
        self.is_closed = False
        self.acknowledges = True
        self._url = f"http://127.0.0.1:{port}/stream"
        self._headers = dict(headers or {})
        source = "live" if bag is None else {"bag": bag}
        first = {"type": "login", "token": token, "protocol": 1, "source": source}
        self._login = dict(login or first)
        self._loop = asyncio.new_event_loop()
        self._socket: aiohttp.ClientWebSocketResponse | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> StreamClient:
        self._thread.start()
        return self

    def __exit__(self, *args: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the connection and end the thread."""
        if self._thread.is_alive() and self._socket is not None:
            closing = self._socket.close()
            try:
                asyncio.run_coroutine_threadsafe(closing, self._loop)
            except RuntimeError:  # the server has closed it, and the thread has just ended
                closing.close()
        self._thread.join(10.0)

    def send(self, **message: Any) -> None:
        """Send a message."""
        assert self._socket is not None
        asyncio.run_coroutine_threadsafe(self._socket.send_json(message), self._loop).result(10.0)

    def send_text(self, text: str) -> None:
        """Send any text."""
        assert self._socket is not None
        asyncio.run_coroutine_threadsafe(self._socket.send_str(text), self._loop).result(10.0)

    @property
    def frames(self) -> list[dict[str, Any]]:
        """All frames."""
        return self.messages["frame"]

    @property
    def errors(self) -> list[str]:
        """Codes of all errors."""
        return [each["code"] for each in self.messages["error"]]

    @property
    def num_tiles(self) -> int:
        """Number of tiles received since the last site."""
        return len(self.tiles)

    def last(self, kind: str) -> dict[str, Any]:
        """Return the last message of a type."""
        return self.messages[kind][-1]

    def heights(self) -> NDArray[np.float32]:
        """Return the elevation [m], shape (rows, cols), from all tiles."""
        site = self.last("site")
        rows, cols = -(-site["rows"] // 16), -(-site["cols"] // 16)
        blocks = np.array([self.tiles[number]["height"] for number in range(rows * cols)])
        matrix = blocks.reshape(rows, cols, 16, 16).swapaxes(1, 2).reshape(rows * 16, cols * 16)
        return matrix[: site["rows"], : site["cols"]]

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_until_complete(self._receive())
        self._loop.close()

    async def _receive(self) -> None:
        async with aiohttp.ClientSession() as session:
            try:
                connection = session.ws_connect(self._url, headers=self._headers, max_msg_size=0)
                async with connection as socket:
                    self.status = 101
                    await socket.send_json(self._login)
                    self._socket = socket
                    async for received in socket:
                        if received.type is aiohttp.WSMsgType.BINARY:
                            await self._process(socket, msgpack.unpackb(received.data))
            except aiohttp.WSServerHandshakeError as error:
                self.status = error.status
        self.is_closed = True

    async def _process(
        self, socket: aiohttp.ClientWebSocketResponse, message: dict[str, Any]
    ) -> None:
        if message["type"] == "site":
            self.tiles = {}
        elif message["type"] == "frame":
            block = message["tiles"]
            tiles = np.frombuffer(block["data"], TILE)
            numbers = np.frombuffer(block["index"], "<u4").tolist()
            self.tiles.update(zip(numbers, tiles, strict=True))
            if self.acknowledges:
                await socket.send_json({"type": "ack", "seq": message["seq"]})
        self.messages[message["type"]].append(message)
