"""The worker draws one picture at a time, and reports a renderer that fails."""

import threading

import pytest

from viewer.cameras.picture_worker import PictureWorker
from viewer.rendering.camera import MachineCamera
from viewer.rendering.errors import RenderError
from viewer.rendering.picture import Picture, PictureSize

SIZE = PictureSize(16, 16)
CAMERA = MachineCamera("cab", "/excavator")
DEADLINE = 10.0


class FakeRenderer:
    """Draws black pictures; counts how often it is closed."""

    closed = 0

    def render(self, camera, size):
        data = bytes(3 * size.width * size.height)
        return Picture(size, "rgb", data, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), 60.0)

    def close(self):
        self.closed += 1


def test_worker_is_busy_until_its_picture_is_taken():
    renderer, done = FakeRenderer(), threading.Event()
    worker = PictureWorker(lambda: renderer, SIZE, done.set)
    assert not worker.is_busy
    assert worker.take() is None
    worker.request(CAMERA)
    assert worker.is_busy
    assert done.wait(DEADLINE)
    assert worker.is_busy
    assert worker.take().camera == CAMERA
    assert not worker.is_busy
    worker.close(DEADLINE)
    assert renderer.closed == 1


def test_renderer_starts_with_the_first_request():
    started, done = threading.Event(), threading.Event()

    def start():
        started.set()
        return FakeRenderer()

    worker = PictureWorker(start, SIZE, done.set)
    worker.close(DEADLINE)
    assert not started.is_set()


def test_failure_of_the_renderer_is_raised_where_pictures_are_taken():
    done = threading.Event()

    def fail():
        raise RenderError("the browser has ended")

    worker = PictureWorker(fail, SIZE, done.set)
    worker.request(CAMERA)
    assert done.wait(DEADLINE)
    with pytest.raises(RenderError, match="browser"):
        worker.take()


def test_any_error_of_the_renderer_ends_the_pictures():
    class LostRenderer(FakeRenderer):
        def render(self, camera, size):
            raise ConnectionResetError("cannot write to closing transport")

    renderer, done = LostRenderer(), threading.Event()
    worker = PictureWorker(lambda: renderer, SIZE, done.set)
    worker.request(CAMERA)
    assert done.wait(DEADLINE)
    with pytest.raises(RenderError, match="ConnectionResetError"):
        worker.take()
    assert renderer.closed
    worker.close(DEADLINE)
