"""Outputs of a film: one file of film, one picture, or a folder of pictures."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from viewer.film.encoder import VIDEO_SUFFIXES, VideoEncoder, encoder_command, find_ffmpeg
from viewer.rendering.errors import RenderError
from viewer.rendering.picture import PictureSize

__all__ = ["PICTURE_SUFFIXES", "FilmOutput", "FolderOutput", "check_output", "open_output"]

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg")

_JPEG_QUALITY = 90


class FilmOutput(Protocol):
    """Takes the frames of a film."""

    def write(self, pixels: NDArray[np.uint8]) -> None:
        """Append a frame: red, green, blue, shape (height, width, 3)."""


class FolderOutput:
    """Writes frame_00001.png, frame_00002.png, ... into a folder, or one picture into a file.

    Attributes:
        path: the folder or the file.
        count: number of pictures written.
    """

    def __init__(self, path: Path, *, is_folder: bool) -> None:
        """
        Args:
            path: the folder, which is created, or the file.
            is_folder: whether it is a folder.

        Raises:
            RenderError: the folder cannot be created.
        """
        self.path, self.count = path, 0
        self._is_folder = is_folder
        if is_folder:
            try:
                path.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise _not_written(path, error) from error

    def write(self, pixels: NDArray[np.uint8]) -> None:
        """Write the next picture: red, green, blue, shape (height, width, 3).

        Raises:
            RenderError: it cannot be written.
        """
        self.count += 1
        path = self.path / f"frame_{self.count:05d}.png" if self._is_folder else self.path
        options = {"quality": _JPEG_QUALITY} if path.suffix != ".png" else {"optimize": True}
        try:
            Image.fromarray(pixels).save(path, **options)
        except OSError as error:
            raise _not_written(path, error) from error


def check_output(path: Path, size: PictureSize, *, is_picture: bool) -> None:
    """Check that an output can be written, before the first frame is drawn.

    Args:
        path: OUT.mp4, OUT.webp, OUT.png, OUT.jpg or a folder.
        size: of the pictures.
        is_picture: whether one picture is wanted.

    Raises:
        RenderError: the output does not suit, or ffmpeg is missing.
    """
    if is_picture and path.suffix not in PICTURE_SUFFIXES:
        raise RenderError(f"one picture is written as .png or .jpg, not as {path}")
    if not is_picture and path.suffix in PICTURE_SUFFIXES:
        raise RenderError(
            f"{path} is one picture: give its time with --at, or an .mp4, a .webp or a folder"
        )
    if path.suffix in VIDEO_SUFFIXES:
        encoder_command(find_ffmpeg(), size, 1.0, "high", path)
    elif path.suffix and not is_picture and not path.is_dir():
        raise RenderError(
            f"{path}: a film is an .mp4 or a .webp, or a folder (a name without a suffix)"
        )
    is_folder = path.suffix not in (*VIDEO_SUFFIXES, *PICTURE_SUFFIXES)
    if is_folder and path.exists() and not path.is_dir():
        raise RenderError(f"{path} is a file; name a folder for the pictures")
    if not is_folder and path.is_dir():
        raise RenderError(f"{path} is a folder; name a file")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RenderError(f"{path.parent} cannot be created: {error}; name another") from error


def open_output(
    path: Path, size: PictureSize, rate: float, quality: str
) -> AbstractContextManager[FilmOutput]:
    """Return the output for a path that was checked by `check_output`.

    The end of the context completes it; pictures are complete as soon as they are written.

    Args:
        path: OUT.mp4, OUT.webp, OUT.png, OUT.jpg or a folder.
        size: of the pictures.
        rate: frames per second.
        quality: low, medium or high.
    """
    if path.suffix in VIDEO_SUFFIXES:
        return VideoEncoder(path, size, rate, quality)
    return nullcontext(FolderOutput(path, is_folder=path.suffix not in PICTURE_SUFFIXES))


def _not_written(path: Path, error: OSError) -> RenderError:
    return RenderError(f"{path} cannot be written: {error.strerror or error}; name another output")
