"""The server of the pictures reports a browser that has gone, at once and with its reason."""

import asyncio
from urllib.parse import urlsplit

import aiohttp
import pytest
from aiohttp import web

from viewer.rendering.camera import MachineCamera
from viewer.rendering.errors import RenderError
from viewer.rendering.page_server import PageServer
from viewer.rendering.picture import PictureSize
from viewer.scene.scene import Scene

SIZE = PictureSize(16, 16)


@pytest.fixture
def page(tmp_path):
    folder = tmp_path / "dist"
    folder.mkdir()
    (folder / "index.html").write_text("<!DOCTYPE html><title>page</title>")
    return folder


async def draw_after(page, action, check):
    """Log in as the page does, let `action` happen to the connection, and request a picture."""
    server = PageServer(Scene(), quality="low", page=page)
    await server.start()
    address = urlsplit(server.url)
    origin = f"http://{address.netloc}"
    try:
        async with aiohttp.ClientSession() as session:
            socket = await session.ws_connect(f"{origin}/stream", origin=origin)
            await socket.send_json({"type": "login", "token": address.fragment[len("token=") :]})
            await socket.receive_bytes()
            await action(socket)
            await server.draw(MachineCamera(), SIZE, "rgb", check)
    finally:
        await server.close()


def test_closed_page_ends_the_next_picture(page):
    async def close(socket):
        await socket.close()

    with pytest.raises(RenderError, match="closed its connection"):
        asyncio.run(draw_after(page, close, lambda: None))


@pytest.mark.parametrize(
    ("has_ended", "reason"), [(True, "browser has ended"), (False, "cannot be reached")]
)
def test_lost_connection_ends_the_picture_with_its_reason(page, monkeypatch, has_ended, reason):
    lost = []

    async def send_bytes(self, data):
        lost.append(data)
        raise aiohttp.ClientConnectionResetError("Cannot write to closing transport")

    async def lose(socket):
        monkeypatch.setattr(web.WebSocketResponse, "send_bytes", send_bytes)

    def check():
        if lost and has_ended:
            raise RenderError("the browser has ended")

    with pytest.raises(RenderError, match=reason):
        asyncio.run(draw_after(page, lose, check))
