"""PageRenderer: pictures of a scene, drawn by the live page in a browser without a window."""

from __future__ import annotations

import asyncio
import concurrent.futures
import threading
from collections.abc import Coroutine
from typing import Any, TypeVar

from viewer.rendering.browser import Browser
from viewer.rendering.camera import Camera, MachineCamera
from viewer.rendering.errors import RenderError
from viewer.rendering.page_server import PageServer
from viewer.rendering.picture import FORMATS, MIN_SIZE, Picture, PictureSize
from viewer.scene.scene import Scene

__all__ = ["QUALITIES", "PageRenderer"]

QUALITIES = ("low", "medium", "high")

_STOP_TIME = 10.0
"""Wall time that the server has to stop [s]."""

_T = TypeVar("_T")


class PageRenderer:
    """Draws pictures of a scene until it is closed, as by `contextlib.closing`.

    The page is served on the loopback address, in a thread of its own. Smoke, dust and particles
    move by the simulation time from one picture to the next, so that the same scenes give the same
    pictures however long each one takes.

    Attributes:
        scene: what is shown. It may change between two pictures.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        quality: str = "high",
        gpu: bool = False,
        window: PictureSize = PictureSize(1280, 720),  # noqa: B008
    ) -> None:
        """
        Args:
            scene: what is shown.
            quality: one of `QUALITIES`.
            gpu: draw with the GPU; else on the CPU.
            window: size of the browser's window.

        Raises:
            RenderError: there is no browser, the page is not built, or a value is not valid.
        """
        if quality not in QUALITIES:
            raise RenderError(f"the quality must be one of {', '.join(QUALITIES)}, not {quality!r}")
        self.scene = scene
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="page", daemon=True)
        self._thread.start()
        self._server: PageServer | None = None
        self._browser: Browser | None = None
        try:
            self._server = self._run(_start_server(scene, quality))
            self._browser = Browser(self._server.url, window, gpu=gpu)
        except BaseException:
            self.close()
            raise

    def render(self, camera: Camera, size: PictureSize, form: str = "rgb") -> Picture:
        """Return a picture of the scene as it is now.

        Args:
            camera: from where.
            size: of the picture.
            form: encoding, one of `FORMATS`.

        Raises:
            RenderError: the browser has ended or reports an error, or it takes too long.
        """
        if form not in (*FORMATS, "none"):
            raise RenderError(f"the format must be one of {', '.join(FORMATS)}, not {form!r}")
        if self._server is None:
            raise RenderError("the renderer is closed")
        return self._run(self._server.draw(camera, size, form, self._check_browser))

    def advance(self) -> None:
        """Let smoke and dust move to the present state of the scene, without a picture.

        Raises:
            RenderError: as `render`.
        """
        self.render(MachineCamera(), PictureSize(MIN_SIZE, MIN_SIZE), "none")

    def close(self) -> None:
        """End the browser and the server."""
        browser, self._browser = self._browser, None
        server, self._server = self._server, None
        if browser is not None:
            browser.close()
        if self._loop.is_closed():
            return
        if server is not None:
            self._run(server.close())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(_STOP_TIME)
        self._loop.close()

    def _run(self, coroutine: Coroutine[Any, Any, _T]) -> _T:
        """Run a coroutine in the thread of the server, and return its result."""
        future = asyncio.run_coroutine_threadsafe(coroutine, self._loop)
        try:
            return future.result()
        except BaseException:
            future.cancel()
            concurrent.futures.wait([future], timeout=_STOP_TIME)
            raise

    def _check_browser(self) -> None:
        browser = self._browser
        if browser is not None and browser.has_ended:
            raise RenderError(f"the browser has ended:\n{browser.log_tail()}")


async def _start_server(scene: Scene, quality: str) -> PageServer:
    server = PageServer(scene, quality=quality)
    await server.start()
    return server
