"""Studio: pictures of worlds, drawn by the live page."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Protocol

from PIL import Image

from earthmoving_sim.figures.figure import FigurePicture
from viewer.film.overlay import draw_overlay
from viewer.rendering.camera import Camera
from viewer.rendering.page_renderer import PageRenderer
from viewer.rendering.picture import PictureSize
from viewer.scene.scene import Scene

__all__ = ["Photographer", "Studio", "Subject"]


class Subject(Protocol):
    """What pictures are taken of."""

    @property
    def scene(self) -> Scene:
        """What is shown."""

    def show(self) -> None:
        """Update the scene."""

    def on_show(self, show: Callable[[], None]) -> None:
        """Call `show` whenever the scene was updated."""

    def close(self) -> None:
        """Release what it has."""


class Photographer:
    """Takes pictures of one subject."""

    def __init__(self, subject: Subject, renderer: PageRenderer, studio: Studio) -> None:
        """
        Args:
            subject: what is shown.
            renderer: draws its scene.
            studio: size and folder of the pictures.
        """
        self._subject, self._renderer, self._studio = subject, renderer, studio
        subject.on_show(renderer.advance)

    def take(
        self, camera: Camera, name: str, caption: str, lines: Sequence[str] = ()
    ) -> FigurePicture:
        """Take a picture of the present state.

        Args:
            camera: from where.
            name: name of the file, without suffix.
            caption: what it shows.
            lines: text in the picture.
        """
        self._subject.show()
        pixels = self._renderer.render(camera, self._studio.size).pixels
        path = self._studio.folder / f"{name}.jpg"
        image = Image.fromarray(draw_overlay(pixels, list(lines)))
        image.save(path, quality=88, optimize=True)
        print(f"  {path}", flush=True)
        return FigurePicture(path, caption)


class Studio:
    """Where pictures go, and how they are drawn.

    Attributes:
        folder: folder of the pictures.
        size: of the pictures.
    """

    def __init__(self, folder: Path, size: PictureSize, *, quality: str, gpu: bool) -> None:
        """
        Args:
            folder: folder of the pictures, which is created.
            size: of the pictures.
            quality: low, medium or high.
            gpu: draw with the GPU.
        """
        self.folder, self.size = folder, size
        self._quality, self._gpu = quality, gpu
        folder.mkdir(parents=True, exist_ok=True)

    @contextmanager
    def photograph(self, subject: Subject) -> Iterator[Photographer]:
        """Yield a photographer of a subject, which is closed at the end."""
        try:
            renderer = PageRenderer(
                subject.scene, quality=self._quality, gpu=self._gpu, window=self.size
            )
            with closing(renderer):
                yield Photographer(subject, renderer, self)
        finally:
            subject.close()
