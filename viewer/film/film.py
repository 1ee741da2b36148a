"""make_film: a film, a series of pictures or one picture of a bag."""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from msg_bridge.bag.bag_files import bag_name
from viewer.film.frame_times import FrameTimes
from viewer.film.outputs import FilmOutput, check_output, open_output
from viewer.film.overlay import draw_overlay
from viewer.film.progress import FilmProgress
from viewer.rendering.browser import find_browser
from viewer.rendering.camera import Camera, MachineCamera
from viewer.rendering.errors import RenderError
from viewer.rendering.page_renderer import PageRenderer
from viewer.rendering.picture import PictureSize
from viewer.scene.scene import Scene
from viewer.sources.bag_scene import BagScene

__all__ = ["END", "FilmRequest", "frame_times", "make_film"]

END = math.inf
"""Time of a picture at the end of the bag."""

_TIME_TOLERANCE = 0.005
"""Time by which an end may lie after that of the bag, because it was rounded [s]."""

_EFFECT_TIME = 2.5
"""Simulated time before the first frame from which on smoke and dust are computed [s]."""

_EFFECT_STEP = 0.1


@dataclass(frozen=True)
class FilmRequest:
    """What to film.

    Attributes:
        bag: folder of a bag, or an .mcap file.
        output: OUT.mp4, OUT.webp, OUT.png or a folder.
        camera: from where.
        size: of the pictures.
        rate: frames per second.
        speed: simulated seconds per second of the film.
        start: first time [s] after the beginning of the bag.
        end: last time [s] after the beginning of the bag; None: the end.
        at: time of a single picture [s] after the beginning of the bag, or `END`; None: a film.
        quality: low, medium or high.
        overlay: whether time, speed and payload are written into the picture.
        gpu: whether the GPU draws.
    """

    bag: Path
    output: Path
    camera: Camera = MachineCamera()  # noqa: RUF009
    size: PictureSize = PictureSize(1280, 720)  # noqa: RUF009
    rate: float = 25.0
    speed: float = 1.0
    start: float = 0.0
    end: float | None = None
    at: float | None = None
    quality: str = "high"
    overlay: bool = False
    gpu: bool = False


def make_film(request: FilmRequest) -> int:
    """Make the film; return the number of frames.

    Raises:
        EarthmovingError: the bag cannot be read, or the output not be written; there is no browser.
        KeyboardInterrupt: by Ctrl-C, after the output was completed.
    """
    is_picture = request.at is not None
    check_output(request.output, request.size, is_picture=is_picture)
    find_browser()
    with closing(BagScene(request.bag)) as bag:
        times = frame_times(request, bag.timeline.duration)
        _show(bag, times.start)
        _check_content(request.camera, bag, times.start)
        renderer = PageRenderer(
            bag.scene, quality=request.quality, gpu=request.gpu, window=request.size
        )
        with closing(renderer):
            _move_effects(bag, renderer, times.start)
            with open_output(request.output, request.size, request.rate, request.quality) as output:
                return _write_frames(request, times, bag, renderer, output)


def frame_times(request: FilmRequest, duration: float) -> FrameTimes:
    """Return the times of the frames.

    Args:
        request: what to film.
        duration: simulated time in the bag [s].

    Raises:
        RenderError: a time lies outside of the bag.
    """
    at = duration if request.at == END else request.at
    start = request.start if at is None else at
    end = duration if request.end is None else request.end
    for name, value in (("start" if at is None else "at", start), ("end", end)):
        if not 0.0 <= value <= duration + _TIME_TOLERANCE:
            raise RenderError(
                f"--{name} {value:g}: {request.bag} has 0 to {duration:.2f} s of simulated time"
            )
    if at is not None:
        return FrameTimes(start, start)
    return FrameTimes(start, end, request.rate, request.speed)


def _show(bag: BagScene, time: float) -> None:
    """Bring the scene of a bag to a time [s]."""
    number = bag.number_at(time)
    if number < bag.position or bag.position == 0:
        bag.restore(number)
    else:
        bag.advance(number)


def _check_content(camera: Camera, bag: BagScene, time: float) -> None:
    """Check that there is something to show.

    Raises:
        RenderError: there is not.
    """
    wanted = camera.machine if isinstance(camera, MachineCamera) else ""
    if wanted and wanted not in bag.machines:
        known = ", ".join(bag.machines) or "none"
        raise RenderError(f"the bag has no machine {wanted}; it has {known}")
    if bag.scene.terrain.tiles is None and not bag.scene.machines:
        raise RenderError(
            f"the bag shows neither terrain nor a machine at {time:g} s; begin later with --start"
        )


def _move_effects(bag: BagScene, renderer: PageRenderer, start: float) -> None:
    """Let smoke and dust form that are in the air at the first frame."""
    time = max(start - _EFFECT_TIME, 0.0)
    while time < start:
        _show(bag, time)
        renderer.advance()
        time += _EFFECT_STEP
    _show(bag, start)


def _write_frames(
    request: FilmRequest,
    times: FrameTimes,
    bag: BagScene,
    renderer: PageRenderer,
    output: FilmOutput,
) -> int:
    progress = FilmProgress(len(times), request.output)
    for number, now in enumerate(times, 1):
        _show(bag, now)
        pixels = renderer.render(request.camera, request.size).pixels
        if request.overlay:
            pixels = draw_overlay(pixels, _overlay_lines(request, bag.scene, now))
        output.write(pixels)
        progress.show(number)
    return len(times)


def _overlay_lines(request: FilmRequest, scene: Scene, now: float) -> list[str]:
    """Return the text of a frame: bag and time, then phase and load of the machine."""
    speed = "" if request.at is not None else f"  {request.speed:g} x"
    lines = [f"{bag_name(request.bag)}  {now:6.1f} s{speed}"]
    wanted = request.camera.machine if isinstance(request.camera, MachineCamera) else ""
    view = scene.machines.get(wanted) or next(iter(scene.machines.values()), None)
    if view is None:
        return lines
    words = [view.namespace.rpartition("/")[2], view.phase]
    if "fill" in view.payload:
        words.append(f"load {100.0 * view.payload['fill']:.0f} %")
    return [*lines, "  ".join(word for word in words if word)]
