"""PictureWorker: draws pictures in a thread of its own, one after the other."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from contextlib import closing
from typing import NamedTuple

from viewer.rendering.camera import MachineCamera
from viewer.rendering.errors import RenderError
from viewer.rendering.page_renderer import PageRenderer
from viewer.rendering.picture import Picture, PictureSize

__all__ = ["PictureWorker", "TakenPicture"]


class TakenPicture(NamedTuple):
    """A picture that was drawn.

    Attributes:
        camera: from where.
        picture: the picture.
    """

    camera: MachineCamera
    picture: Picture


class PictureWorker:
    """Draws one picture at a time; while it does, further requests are not accepted.

    Requests and results are handled in one thread, that of the ROS executor.
    """

    def __init__(
        self,
        make_renderer: Callable[[], PageRenderer],
        size: PictureSize,
        wake: Callable[[], None],
    ) -> None:
        """
        Args:
            make_renderer: starts the renderer; called in the thread of the worker.
            size: of the pictures.
            wake: called in the thread of the worker when a result can be taken.
        """
        self._make_renderer, self._size, self._wake = make_renderer, size, wake
        self._requests: queue.SimpleQueue[MachineCamera | None] = queue.SimpleQueue()
        self._results: queue.SimpleQueue[TakenPicture | RenderError] = queue.SimpleQueue()
        self._is_busy = False
        self._renderer: PageRenderer | None = None
        self._thread = threading.Thread(target=self._run, name="pictures", daemon=True)
        self._thread.start()

    @property
    def is_busy(self) -> bool:
        """Whether a picture is being drawn, or was drawn and not taken."""
        return self._is_busy

    def request(self, camera: MachineCamera) -> None:
        """Request a picture; the worker must not be busy."""
        self._is_busy = True
        self._requests.put(camera)

    def take(self) -> TakenPicture | None:
        """Return the picture that was drawn; None while there is none.

        Raises:
            RenderError: there will be no more pictures.
        """
        try:
            result = self._results.get_nowait()
        except queue.Empty:
            return None
        if isinstance(result, RenderError):
            raise result
        self._is_busy = False
        return result

    def close(self, timeout: float) -> None:
        """End the renderer, also while it draws.

        Args:
            timeout: maximum wall time to wait [s].
        """
        self._requests.put(None)
        renderer = self._renderer
        if self._is_busy and renderer is not None:
            renderer.close()  # the picture that is being drawn fails
        self._thread.join(timeout)

    def _run(self) -> None:
        try:
            first = self._requests.get()
            if first is None:
                return
            with closing(self._make_renderer()) as renderer:
                self._renderer = renderer
                camera: MachineCamera | None = first
                while camera is not None:
                    picture = renderer.render(camera, self._size)
                    self._results.put(TakenPicture(camera, picture))
                    self._wake()
                    camera = self._requests.get()
        except RenderError as error:
            self._report(error)
        except Exception as error:  # not foreseen: the node has to end, and not to go silent
            failure = RenderError(f"no picture can be drawn: {type(error).__name__}: {error}")
            failure.__cause__ = error
            self._report(failure)

    def _report(self, error: RenderError) -> None:
        """Let the next `take` raise an error."""
        self._results.put(error)
        self._wake()
